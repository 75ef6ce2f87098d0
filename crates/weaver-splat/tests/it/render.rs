//! Pictures from cameras.

use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_scene::ActivatedGaussians;
use weaver_splat::{RasterSettings, Workspace, render};

#[test]
fn a_camera_sees_the_same_alone_and_among_others_of_any_size() {
    let gaussians = ActivatedGaussians {
        means: vec![0.0, 0.0, 2.0, 0.3, -0.2, 1.5],
        scales: vec![0.2, 0.1, 0.3, 0.1, 0.1, 0.4],
        quats: vec![1.0, 0.0, 0.0, 0.0, 0.5, 0.5, -0.5, 0.5],
        opacities: vec![0.9, 0.6],
        sh: vec![1.0, 0.0, -1.0, 0.5, 0.5, 2.0],
        degree: 0,
    };
    let camera = |x: f64, width: usize, height: usize| Camera {
        pose: Pose::from_wxyz([1.0, 0.0, 0.1, 0.0], DVec3::new(x, 0.0, 0.0)),
        intrinsics: Intrinsics { fx: 20.0, fy: 20.0, cx: width as f64 / 2.0, cy: height as f64 / 2.0 },
        width,
        height,
    };
    let cameras = [camera(0.0, 16, 12), camera(0.1, 16, 12), camera(0.0, 5, 9)];
    let (settings, background) = (RasterSettings::default(), [0.1, 0.2, 0.3]);
    let mut workspace = Workspace::new();
    let together = render(&gaussians, &cameras, background, &settings, &mut workspace).unwrap();
    for (camera, image) in cameras.iter().zip(&together) {
        let alone = render(&gaussians, std::slice::from_ref(camera), background, &settings, &mut workspace).unwrap();
        assert_eq!(&alone[0], image);
        assert_eq!(image.len(), 3 * camera.width * camera.height);
        assert!(image.iter().any(|x| !background.contains(x)), "the Gaussians are in view");
    }
    assert!(render(&gaussians, &[], background, &settings, &mut workspace).unwrap().is_empty());
    let broken = ActivatedGaussians { scales: vec![0.1; 3], ..gaussians };
    let error = render(&broken, &cameras, background, &settings, &mut workspace).unwrap_err();
    assert!(error.to_string().contains("scales"), "{error}");
}
