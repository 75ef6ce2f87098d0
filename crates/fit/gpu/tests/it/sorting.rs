//! The sort on the device: ascending and stable, for any number and kind of keys.

use crate::device::rasterizer;
use weaver_gpu::{GpuRasterizer, sort_pairs};
use weaver_kernels::random::Stream;

fn check(rasterizer: &GpuRasterizer, keys: &[u32], bits: u32) {
    let mut sorted = keys.to_vec();
    let mut values: Vec<u32> = (0..keys.len() as u32).collect();
    sort_pairs(rasterizer.context(), &mut sorted, &mut values, bits).unwrap();
    let mut expected = values.clone();
    expected.sort_unstable();
    // Rust's is stable, and so says which value stands where among equal keys.
    expected.sort_by_key(|value| keys[*value as usize]);
    assert!(values == expected, "{} keys of {bits} bits", keys.len());
    assert!(sorted.iter().zip(&values).all(|(key, value)| *key == keys[*value as usize]));
}

fn drawn(len: usize, kinds: u64) -> Vec<u32> {
    let stream = Stream::new(len as u64, kinds, "gpu.sort");
    (0..len as u64).map(|i| stream.below(i, kinds as usize) as u32).collect()
}

#[test]
fn ascending_and_stable() {
    let Some(rasterizer) = rasterizer() else { return };
    for len in [0, 1, 2, 7, 8, 9, 255, 256, 257, 2047, 2048, 2049, 10_007] {
        check(&rasterizer, &drawn(len, 1 << 32), 32);
        check(&rasterizer, &drawn(len, 5), 32);
        check(&rasterizer, &drawn(len, 1108), 11);
        check(&rasterizer, &vec![7; len], 4);
        check(&rasterizer, &vec![u32::MAX; len], 32);
    }
}

/// More groups of keys than a work group has threads.
#[test]
fn a_million_keys() {
    let Some(rasterizer) = rasterizer() else { return };
    check(&rasterizer, &drawn((1 << 20) + 3, 1 << 12), 12);
}
