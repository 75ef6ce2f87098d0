//! Pictures from cameras.

use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, Pose, Similarity, so3};
use weaver_scene::{ActivatedGaussians, Gaussians};
use weaver_splat::{RasterSettings, Workspace, render};

/// A camera sees the same alone and among others of any size.
#[test]
fn cameras_see_the_same_alone_and_together() {
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

/// A scene carried into another world looks the same from a camera carried along.
#[test]
fn scene_and_camera_move_together() {
    let draw = |i: usize| ((i * 7919) % 101) as f32 / 50.0 - 1.0;
    let n = 12;
    let gaussians = Gaussians {
        means: (0..n).map(|i| [draw(3 * i), draw(3 * i + 1), 4.0 + draw(3 * i + 2)]).collect(),
        log_scales: (0..n).map(|i| [draw(i + 50) - 1.5, draw(i + 60) - 1.5, draw(i + 70) - 1.5]).collect(),
        quats: (0..n).map(|i| [draw(i), draw(i + 1) + 0.3, draw(i + 2), draw(i + 3)]).collect(),
        opacity_logits: (0..n).map(|i| draw(i + 20)).collect(),
        sh: (0..n * 48).map(|i| 0.3 * draw(i)).collect(),
        degree: 3,
    };
    let intrinsics = Intrinsics { fx: 24.0, fy: 22.0, cx: 16.0, cy: 12.0 };
    let camera = Camera { pose: Pose::IDENTITY, intrinsics, width: 32, height: 24 };
    let rotation = so3::exp(DVec3::new(0.7, -1.1, 0.4));
    let to = Similarity { scale: 2.5, rotation, translation: DVec3::new(3.0, -1.0, 0.5) };
    let carried = Camera { pose: to.apply_to_pose(&camera.pose), ..camera };
    let picture = |gaussians: &Gaussians, camera: Camera| {
        let settings = RasterSettings::default();
        render(&gaussians.to_activated(), &[camera], [0.2; 3], &settings, &mut Workspace::new()).unwrap().remove(0)
    };
    let (here, there) = (picture(&gaussians, camera), picture(&gaussians.transformed(&to), carried));
    assert!(here.iter().any(|x| (x - 0.2).abs() > 0.2), "something is in view");
    let largest = here.iter().zip(&there).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(largest < 1e-4, "{largest}");
}
