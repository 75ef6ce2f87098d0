//! Choice of pairs among hundreds of photos.

use criterion::Criterion;
use std::hint::black_box;
use weaver_geometry::glam::DVec2;
use weaver_kernels::random::Stream;
use weaver_sfm::{DESCRIPTOR, Features, Keypoint, candidates};

/// Keypoints of a photo; neighbors in a row share half of them.
const KEYPOINTS: usize = 3000;

/// Length of a descriptor.
const LENGTH: f32 = 250.0;

/// Photos whose descriptors are drawn: as costly as real ones.
fn photos(count: usize) -> Vec<Features> {
    let photo = |photo: usize| {
        let mut features = Features::default();
        for i in 0..KEYPOINTS {
            let of = Stream::new(1, (photo * KEYPOINTS / 2 + i) as u64, "bench.landmarks");
            let values: [f32; DESCRIPTOR] = std::array::from_fn(|j| of.uniform::<f32>(j as u64).powi(4));
            let length = values.iter().map(|x| x * x).sum::<f32>().sqrt();
            features.descriptors.extend(values.iter().map(|x| (LENGTH * x / length).round() as u8));
            let scale = 2.0 + (i % 97) as f64;
            features.keypoints.push(Keypoint { pixel: DVec2::ZERO, scale, angle: 0.0, contrast: 1.0 });
        }
        features
    };
    (0..count).map(photo).collect()
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("candidates");
    group.sample_size(10);
    for count in [50, 300] {
        let photos = photos(count);
        let name = format!("{count} photos of {KEYPOINTS} keypoints, 20 each");
        group.bench_function(name, |b| b.iter(|| black_box(candidates(&photos, &vec![true; count], 20, false))));
    }
    group.finish();
    criterion.final_summary();
}
