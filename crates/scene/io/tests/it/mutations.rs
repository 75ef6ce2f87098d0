//! How a valid file is spoilt: the same for a stream of numbers, so that a failure can be repeated.

use weaver_kernels::random::Stream;

/// Files per reader in an ordinary run; `WEAVER_MUTATIONS` sets another number.
const FILES: u64 = 40;

pub fn files() -> u64 {
    std::env::var("WEAVER_MUTATIONS").map_or(FILES, |n| n.parse().unwrap())
}

/// Changes a file in one to three ways.
pub fn mutate(bytes: &mut Vec<u8>, rng: Stream) {
    for round in 0..1 + rng.below(0, 3) as u64 {
        let rng = rng.fork(1 + round);
        let at = rng.below(0, bytes.len().max(1));
        let some = (1 + rng.below(1, 24)).min(bytes.len().saturating_sub(at));
        match rng.below(2, 8) {
            0 => (0..1 + rng.below(3, 8) as u64).for_each(|i| {
                let bit = rng.fork(9).bits(i) as usize % (8 * bytes.len()).max(1);
                if let Some(byte) = bytes.get_mut(bit / 8) {
                    *byte ^= 1 << (bit % 8);
                }
            }),
            1 => bytes.truncate(at),
            2 => {
                bytes.splice(at..at, (0..some as u64).map(|i| rng.bits(10 + i) as u8).collect::<Vec<_>>());
            }
            3 => {
                let chunk = bytes[at..at + some].to_vec();
                let to = rng.below(4, bytes.len() + 1);
                bytes.splice(to..to, chunk);
            }
            4 => drop(bytes.drain(at..at + some)),
            5 | 6 => extreme(bytes, at, rng),
            _ => edit_number(bytes, at, rng),
        }
    }
}

/// Overwrites a binary number by one at a border, of 1 to 8 bytes and either byte order.
fn extreme(bytes: &mut [u8], at: usize, rng: Stream) {
    let size = 1 << rng.below(5, 4);
    let borders = [0, 1, u64::MAX, u64::MAX >> 1, i64::MIN as u64, 0x7fff_ffff, 0x8000_0000, 0xffff, 1 << 40];
    let number = borders[rng.below(6, borders.len())].to_le_bytes();
    let mut number = number[..size].to_vec();
    if rng.below(7, 2) == 1 {
        number.reverse();
    }
    bytes.iter_mut().skip(at).zip(number).for_each(|(byte, new)| *byte = new);
}

/// Replaces the run of digits at or after a place.
fn edit_number(bytes: &mut Vec<u8>, at: usize, rng: Stream) {
    let texts = ["-1", "0", "", "99999999999", "18446744073709551615", "1e308", "nan", "-inf", "4294967295", "1e-320"];
    let Some(start) = bytes.iter().skip(at).position(u8::is_ascii_digit).map(|i| at + i) else { return };
    let digits = bytes[start..].iter().take_while(|byte| byte.is_ascii_digit()).count();
    bytes.splice(start..start + digits, texts[rng.below(5, texts.len())].bytes());
}
