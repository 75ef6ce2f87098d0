//! Cameras out of every file that holds some.

use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_io::colmap::Model;
use weaver_io::realestate::{Clip, ClipFrame};
use weaver_io::{Transforms, read_cameras};
use weaver_scene::Frame;

fn frames() -> Vec<Frame> {
    let frame = |i: u32| {
        let t = f64::from(i);
        let pose = Pose::from_wxyz([1.0, 0.1 * t, 0.2, -0.3], DVec3::new(t, 0.5, 2.0));
        let intrinsics = Intrinsics { fx: 9.0 + t, fy: 8.5, cx: 4.25, cy: 3.0 };
        Frame::new(format!("{i}.png"), Camera { pose, intrinsics, width: 8, height: 6 })
    };
    (0..3).map(frame).collect()
}

fn assert_same(a: &[Frame], b: &[Frame]) {
    assert_eq!(a.len(), b.len());
    for (a, b) in a.iter().zip(b) {
        assert_eq!((&a.name, a.camera.width, a.camera.height), (&b.name, b.camera.width, b.camera.height));
        assert_eq!(a.camera.intrinsics, b.camera.intrinsics);
        let moved = a.camera.pose.translation.distance(b.camera.pose.translation);
        assert!(a.camera.pose.angle_to(&b.camera.pose) < 1e-6 && moved < 1e-9);
    }
}

#[test]
fn of_a_transforms_file_without_its_images() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("transforms.json");
    Transforms { frames: frames(), ..Transforms::default() }.write(&path).unwrap();
    assert_same(&read_cameras(&path).unwrap(), &frames());
}

#[test]
fn of_a_model_wherever_the_folder_has_it() {
    for place in ["", "sparse", "sparse/0"] {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join(place);
        std::fs::create_dir_all(&target).unwrap();
        let mut backward = frames();
        backward.reverse();
        let model = Model::from_frames(&backward);
        assert_same(&model.frames(), &backward);
        model.write_binary(&target).unwrap();
        assert_same(&read_cameras(folder.path()).unwrap(), &frames());
    }
}

#[test]
fn of_a_clip_for_images_of_one_pixel() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cameras.txt");
    let frame = ClipFrame { timestamp: 33_000, normalized: [0.5, 0.8, 0.5, 0.5], pose: Pose::IDENTITY };
    Clip { url: "http://a".into(), frames: vec![frame] }.write(&path).unwrap();
    let [read] = &read_cameras(&path).unwrap()[..] else { panic!("one frame") };
    assert_eq!((read.name.as_str(), read.time, read.camera.width), ("33000", Some(33_000.0), 1));
    assert_eq!(read.camera.intrinsics.resized(64.0, 48.0), frame.intrinsics(64, 48));
}
