//! Surfaces: the distance of a scene from itself, and from a moved one.

use crate::scenes::pictures;
use weaver_compress::CompressError;
use weaver_compression::{CompressionError, Surface};
use weaver_kernels::random::Stream;
use weaver_scene::{Gaussians, orbit};

/// Opaque flat Gaussians on a sphere of this radius.
fn ball(radius: f32) -> Gaussians {
    let stream = Stream::new(3, 0, "ball");
    let direction = |i: u64| {
        let v: [f32; 3] = std::array::from_fn(|a| stream.normal::<f32>(3 * i + a as u64));
        let length = v.iter().map(|x| x * x).sum::<f32>().sqrt();
        v.map(|x| x / length)
    };
    let count = 4000;
    Gaussians {
        means: (0..count).map(|i| direction(i).map(|x| x * radius)).collect(),
        log_scales: vec![[(0.05_f32 * radius).ln(); 3]; count as usize],
        quats: vec![[1.0, 0.0, 0.0, 0.0]; count as usize],
        opacity_logits: vec![6.0; count as usize],
        sh: vec![0.3; 3 * count as usize],
        degree: 0,
    }
}

#[test]
fn balls_are_as_far_apart_as_their_radii_differ() {
    let gaussians = ball(1.0);
    let cameras = orbit(&gaussians, 12, [96, 96]).unwrap();
    let surface = Surface::new(&gaussians, &pictures(&cameras)).unwrap();
    assert_eq!(surface.chamfer(&gaussians).unwrap(), 0.0);
    let distance = cameras[0].pose.center().length();
    let expected = 1000.0 * 0.05 / distance;
    let found = surface.chamfer(&ball(1.05)).unwrap();
    assert!((found / expected - 1.0).abs() < 0.2, "{found} of {expected}");
    // A hundredth of a cell, which no spacing of points hides.
    let hardly = surface.chamfer(&ball(1.0002)).unwrap();
    assert!(hardly < 0.1 * found, "{hardly} beside {found}");
}

/// A surface without points has the largest distance, a twentieth of the cameras'.
///
/// Promise of `nothing_is_no_good_mesh`.
#[test]
fn a_surface_that_is_not_there_is_far_off() {
    let gaussians = ball(1.0);
    let cameras = orbit(&gaussians, 4, [48, 48]).unwrap();
    let surface = Surface::new(&gaussians, &pictures(&cameras)).unwrap();
    let nothing = Gaussians { opacity_logits: vec![-20.0; gaussians.means.len()], ..gaussians };
    assert_eq!(surface.chamfer(&nothing).unwrap(), 50.0);
}

#[test]
fn no_camera_is_an_error() {
    assert!(matches!(
        Surface::new(&ball(1.0), &pictures(&[])),
        Err(CompressionError::Compress(CompressError::NoCameras))
    ));
}
