//! Files: round trips, and refusals of other bytes.

use crate::random::{error, gaussians, picture};
use proptest::prelude::*;
use std::ops::ControlFlow;
use weaver_codec::{Container, Stream};
use weaver_image::{CUT, FitSettings, Fitted, Window, decode, decode_region, encode, encode_in_blocks, fit};

fn random(seed: u64, count: usize, size: [usize; 2]) -> Fitted {
    Fitted { gaussians: gaussians(seed, count, size, [0.3, 20.0]), cut: CUT, reset: 0 }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 8))]

    #[test]
    fn what_was_read_is_written_to_the_same_bytes(seed: u64, count in 0_usize..60, width in 8_usize..6000) {
        let bytes = encode(&random(seed, count, [width, 90]), width, 90).unwrap();
        let back = decode(&bytes).unwrap();
        prop_assert_eq!((back.width, back.height, back.fitted.gaussians.len()), (width, 90, count));
        prop_assert_eq!(encode(&back.fitted, width, 90).unwrap(), bytes);
    }

    #[test]
    fn blocks_hold_the_same_gaussians(seed: u64, count in 0_usize..90, most in 1_usize..50) {
        let fitted = random(seed, count, [300, 90]);
        let bytes = encode_in_blocks(&fitted, 300, 90, most).unwrap();
        let (whole, blocks) = (decode(&encode(&fitted, 300, 90).unwrap()).unwrap(), decode(&bytes).unwrap());
        prop_assert_eq!(sorted(&whole.fitted), sorted(&blocks.fitted));
        prop_assert_eq!(encode_in_blocks(&blocks.fitted, 300, 90, most).unwrap(), bytes);
    }

    #[test]
    fn a_region_of_a_file_has_the_bits_of_the_whole(
        seed: u64,
        [x, y] in proptest::array::uniform2(0_usize..200),
        side in 1_usize..60,
        factor in 0.2_f64..3.0,
    ) {
        let bytes = encode_in_blocks(&random(seed, 120, [200, 200]), 200, 200, 8).unwrap();
        let size = (200.0 * factor).round() as usize;
        let inside = |first: usize| (first as f64 * factor) as usize % size;
        let (x, y) = (inside(x), inside(y));
        let window = Window { x, y, width: side.min(size - x), height: side.min(size - y) };
        let mut longest = 0;
        let mut read = |range: std::ops::Range<u64>| {
            longest = longest.max(range.end);
            Ok(bytes[range.start as usize..range.end as usize].to_vec())
        };
        let part = decode_region(bytes.len() as u64, &mut read, window.around(factor, CUT)).unwrap();
        prop_assert!(longest <= bytes.len() as u64);
        let drawn = |mut fitted: Fitted| {
            fitted.gaussians = fitted.gaussians.at_scale(factor);
            fitted.draw_window(window).unwrap()
        };
        prop_assert_eq!(drawn(part.fitted), drawn(decode(&bytes).unwrap().fitted));
    }

    #[test]
    fn changed_bytes_are_refused_or_a_picture(seed: u64, at: proptest::sample::Index, to: u8) {
        let mut bytes = encode(&random(seed, 20, [64, 64]), 64, 64).unwrap();
        let at = at.index(bytes.len());
        let same = bytes[at] == to;
        bytes[at] = to;
        prop_assert_eq!(decode(&bytes).is_ok(), same);
    }
}

/// Gaussians in an order that does not depend on the file's.
fn sorted(of: &Fitted) -> Vec<[u32; 8]> {
    let g = &of.gaussians;
    let numbers = |i: usize| {
        let of =
            [&g.centers[2 * i..2 * i + 2], &g.scales[2 * i..2 * i + 2], &g.angles[i..=i], &g.colors[3 * i..3 * i + 3]];
        <[u32; 8]>::try_from(of.concat().into_iter().map(f32::to_bits).collect::<Vec<_>>()).unwrap()
    };
    let mut all: Vec<[u32; 8]> = (0..g.len()).map(numbers).collect();
    all.sort_unstable();
    all
}

#[test]
fn only_blocks_of_the_region_are_read() {
    let fitted = Fitted { gaussians: gaussians(4, 20_000, [2000, 2000], [2.0, 8.0]), cut: CUT, reset: 0 };
    let mut bytes = encode_in_blocks(&fitted, 2000, 2000, 256).unwrap();
    let part = |bytes: &[u8], window: Window| {
        let mut taken = 0;
        let mut read = |range: std::ops::Range<u64>| {
            taken += range.end - range.start;
            Ok(bytes[range.start as usize..range.end as usize].to_vec())
        };
        decode_region(bytes.len() as u64, &mut read, window).map(|coded| (coded.fitted, taken))
    };
    let window = Window { x: 900, y: 900, width: 64, height: 64 };
    let (found, taken) = part(&bytes, window).unwrap();
    assert!(taken < bytes.len() as u64 / 8, "{taken} of {}", bytes.len());
    assert!(found.gaussians.len() <= 9 * 256);
    // Damage elsewhere does not affect this region, but the whole.
    let last = bytes.len() - 40;
    bytes[last] ^= 1;
    assert!(decode(&bytes).is_err());
    assert_eq!(part(&bytes, window).unwrap().0, found);
    let refusal = part(&bytes, Window::whole(2000, 2000)).unwrap_err().to_string();
    assert!(refusal.starts_with("stream gaus"), "{refusal}");
    for end in [0, 5, 100, 5000, bytes.len() - 1] {
        assert!(part(&bytes[..end], window).is_err());
    }
}

#[test]
fn shortened_files_are_refused() {
    let bytes = encode(&random(1, 20, [64, 64]), 64, 64).unwrap();
    for end in 0..bytes.len() {
        assert!(decode(&bytes[..end]).is_err());
    }
    let message = decode(b"PNG..").unwrap_err().to_string();
    assert!(message.starts_with("byte 0: expected"), "{message}");
}

#[test]
fn symbols_are_near_the_numbers() {
    let before = random(2, 1, [100, 100]);
    let back = decode(&encode(&before, 100, 100).unwrap()).unwrap().fitted.gaussians;
    for axis in 0..2 {
        assert!((back.centers[axis] - before.gaussians.centers[axis]).abs() < 1.5);
    }
    let sorted = |s: &[f32]| [s[0].max(s[1]), s[0].min(s[1])];
    for (a, b) in sorted(&back.scales).into_iter().zip(sorted(&before.gaussians.scales)) {
        assert!((a / b).log2().abs() < 0.36, "{a} {b}");
    }
}

#[test]
fn a_coded_fit_is_what_its_file_holds() {
    let picture = picture(3, 64, 64);
    let mut settings = FitSettings::new(60, 120);
    let free = fit(&picture, &settings, &mut |_| ControlFlow::Continue(())).unwrap();
    settings.coded = true;
    let coded = fit(&picture, &settings, &mut |_| ControlFlow::Continue(())).unwrap();
    let back = |fitted: &Fitted| decode(&encode(fitted, 64, 64).unwrap()).unwrap().fitted.gaussians;
    let (rounded, staged) = (error(&picture, &back(&free)), error(&picture, &back(&coded)));
    let told = error(&picture, &coded.gaussians);
    assert!((staged - told).abs() < 0.02 * told, "{staged} {told}");
    assert!(staged < rounded, "{staged} {rounded}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]

    /// Any symbols with valid checksums are a picture or refused.
    #[test]
    fn any_symbols_are_a_picture_or_refused(
        symbols in proptest::collection::vec(any::<u8>(), 0..400),
        gaussians in 0_u64..3000,
        [width, height] in proptest::array::uniform2(0_u32..5000),
        end in any::<[u8; 2]>(),
        place in any::<[u8; 32]>(),
        blocks in 1_usize..3,
    ) {
        let mut head: Vec<u8> = [&width.to_le_bytes()[..], &height.to_le_bytes(), &end].concat();
        let stream = |name, symbols, bytes: Vec<u8>| Stream { name, symbols, bytes: bytes.into() };
        if blocks > 1 {
            head.extend(place);
        }
        let mut streams = vec![stream(*b"pict", 1, head), stream(*b"gaus", gaussians, symbols.clone())];
        streams.extend((1..blocks).map(|_| stream(*b"gaus", 0, symbols.clone())));
        let bytes = Container { gaussians, coefficients: 0, streams }.write();
        if let Ok(coded) = decode(&bytes) {
            coded.fitted.gaussians.check().unwrap();
        }
        let mut read = |range: std::ops::Range<u64>| Ok(bytes[range.start as usize..range.end as usize].to_vec());
        let _ = decode_region(bytes.len() as u64, &mut read, Window { x: 9, y: 9, width: 40, height: usize::MAX });
    }
}
