//! Cameras and their rows of numbers.

use proptest::prelude::*;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_scene::{CameraRows, CameraSlices};

fn cameras() -> impl Strategy<Value = Vec<Camera>> {
    let camera = (
        prop::array::uniform4(-1.0f64..1.0),
        prop::array::uniform3(-5.0f64..5.0),
        prop::array::uniform4(10.0f64..100.0),
    )
        .prop_filter("a rotation", |(q, ..)| q.iter().map(|x| x * x).sum::<f64>() > 0.01)
        .prop_map(|(q, t, [fx, fy, cx, cy])| Camera {
            pose: Pose::from_wxyz(q, DVec3::from(t)),
            intrinsics: Intrinsics { fx, fy, cx, cy },
            width: 64,
            height: 48,
        });
    prop::collection::vec(camera, 0..4)
}

proptest! {
    #[test]
    fn cameras_survive_their_rows(cameras in cameras()) {
        let rows = CameraRows::new(&cameras);
        let slices = rows.as_slices(&[0.1, 0.2, 0.3]);
        prop_assert_eq!((slices.views(), rows.viewmats.len()), (cameras.len(), 12 * cameras.len()));
        let back = slices.to_cameras();
        prop_assert_eq!(back.len(), cameras.len());
        for (a, b) in back.iter().zip(&cameras) {
            prop_assert!(a.pose.angle_to(&b.pose) < 1e-3 && a.pose.translation.distance(b.pose.translation) < 1e-5);
            prop_assert!((a.intrinsics.fx - b.intrinsics.fx).abs() < 1e-4 && a.width == b.width);
        }
        // Rounded once, they stay as they are.
        let again = CameraRows::new(&back);
        prop_assert_eq!(&again.viewmats, &rows.viewmats);
        prop_assert_eq!(&again.intrinsics, &rows.intrinsics);
    }

    #[test]
    fn a_fourth_row_is_not_read(cameras in cameras()) {
        let rows = CameraRows::new(&cameras);
        let viewmats: Vec<f32> =
            rows.viewmats.chunks(12).flat_map(|m| m.iter().copied().chain([0.0, 0.0, 0.0, 1.0])).collect();
        let square = CameraSlices { viewmats: &viewmats, ..rows.as_slices(&[]) };
        prop_assert_eq!(square.to_cameras(), rows.as_slices(&[]).to_cameras());
    }
}

#[test]
fn a_background_serves_one_view_or_all() {
    let rows = CameraRows { intrinsics: vec![0.0; 8], ..CameraRows::default() };
    assert_eq!(rows.as_slices(&[1.0, 2.0, 3.0]).background_of(1), [1.0, 2.0, 3.0]);
    assert_eq!(rows.as_slices(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).background_of(1), [4.0, 5.0, 6.0]);
}
