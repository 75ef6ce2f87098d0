//! Depth of a planted wall from four photos, and how far it is off.

#[path = "../tests/it/planted.rs"]
mod planted;

use weaver_geometry::glam::DVec2;
use weaver_kernels::order::median_high;
use weaver_stereo::{Stereo, StereoSettings};

fn main() {
    let planted::Planted { photos, points, visible } = planted::wall(4);
    let stereo = Stereo::of(&photos, &points, &visible, &StereoSettings::default());
    for (n, (photo, coverage)) in photos.iter().zip(stereo.coverage()).enumerate() {
        let (depth, [_, width]) = stereo.depth(n);
        let error = |(at, depth): (usize, &f32)| {
            let pixel = DVec2::new((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
            (f64::from(*depth) * planted::inverse_depth(&photo.camera, pixel) - 1.0).abs()
        };
        let mut errors: Vec<f64> = depth.iter().enumerate().filter(|(_, d)| !d.is_nan()).map(error).collect();
        let median = median_high(&mut errors).unwrap_or(f64::NAN);
        println!(
            "{}: depth for {:.0} % of pixels, off by {:.3} % in the median",
            photo.name,
            100.0 * coverage,
            100.0 * median
        );
    }
    println!("{} Gaussians on {} pixels", stereo.surface().gaussians(500).len(), stereo.surface().len());
}
