//! Scene types through a format of serde, by the feature of that name.

use weaver_geometry::lens::Lens;
use weaver_geometry::{Camera, Distortion, Intrinsics, Pose, Similarity};
use weaver_scene::{Frame, Gaussians, Photo, PointCloud, Region};

#[test]
fn scene_types_come_back_from_json() {
    fn back<T: serde::Serialize + serde::de::DeserializeOwned + PartialEq + std::fmt::Debug>(value: &T) {
        let text = serde_json::to_string(value).unwrap();
        assert_eq!(&serde_json::from_str::<T>(&text).unwrap(), value, "{text}");
    }
    let intrinsics = Intrinsics { fx: 50.5, fy: 49.25, cx: 32.0, cy: 24.0 };
    let camera = Camera { pose: Pose::IDENTITY, intrinsics, width: 64, height: 48 };
    back(&camera);
    back(&Similarity { scale: 2.5, rotation: camera.pose.rotation, translation: camera.pose.translation });
    let distortion = Some(Distortion::Radial { k: [0.1, -0.01, 0.0, 0.0, 0.0, 0.0], p: [0.0; 2] });
    back(&Frame { distortion, time: Some(0.5), ..Frame::new("a.jpg", camera) });
    back(&Photo {
        name: "a.jpg".into(),
        camera,
        rgb: vec![1, 2, 3].into(),
        mask: Some(vec![true]),
        lens: Some(Lens::Equirectangular),
    });
    back(&PointCloud { positions: vec![[0.5, -1.0, 2.0]], colors: vec![[255, 0, 7]] });
    back(&Region::Sphere { center: [0.0, 1.0, 2.0], radius: 0.1 });
    back(&Gaussians {
        means: vec![[0.0, 0.0, 2.0]],
        log_scales: vec![[-1.0; 3]],
        quats: vec![[1.0, 0.0, 0.0, 0.0]],
        opacity_logits: vec![0.25],
        sh: vec![0.1, 0.2, 0.3],
        degree: 0,
    });
}
