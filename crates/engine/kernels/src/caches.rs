//! Sizes of the processor's caches.

use std::sync::OnceLock;

/// Assumed where the processor does not tell.
const DEFAULT: usize = 1 << 18;

/// Bytes of the second-level cache.
pub(crate) fn second_level() -> usize {
    static BYTES: OnceLock<usize> = OnceLock::new();
    *BYTES.get_or_init(|| told(2).unwrap_or(DEFAULT))
}

/// Bytes of the data cache of this level, if the processor tells: leaf 4 of `cpuid`, which AMD's have elsewhere.
#[cfg(target_arch = "x86_64")]
fn told(level: u32) -> Option<usize> {
    use std::arch::x86_64::{__cpuid, __cpuid_count};
    [4, 0x8000_001d].into_iter().filter(|leaf| __cpuid(leaf & 0x8000_0000).eax >= *leaf).find_map(|leaf| {
        // A type of 0 ends the list; 2 are instructions alone.
        let listed = (0..16).map(|index| __cpuid_count(leaf, index)).take_while(|cache| cache.eax & 31 != 0);
        let mut data = listed.filter(|cache| cache.eax & 31 != 2 && cache.eax >> 5 & 7 == level);
        data.next().map(|cache| {
            let factors = [cache.ebx >> 22, cache.ebx >> 12 & 0x3ff, cache.ebx & 0xfff, cache.ecx];
            factors.into_iter().map(|factor| factor as usize + 1).product()
        })
    })
}

#[cfg(not(target_arch = "x86_64"))]
fn told(_level: u32) -> Option<usize> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_those_of_caches() {
        assert!((1 << 16..1 << 26).contains(&second_level()), "{}", second_level());
        if let (Some(first), Some(second)) = (told(1), told(2)) {
            assert!(first < second && first >= 1 << 13, "{first} {second}");
        }
    }
}
