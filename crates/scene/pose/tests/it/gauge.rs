use proptest::prelude::*;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;
use weaver_pose::{activate, first_camera_gauge};

fn codes(seed: u64, scenes: usize, views: usize) -> Input {
    let mut codes = Input::normal(seed, [scenes, views, 9]);
    // No quaternion near 0, and no relative w near the sign change at 0.
    for (i, code) in codes.data.chunks_mut(9).enumerate() {
        code[6] = if i % 2 == 0 { 3.0 } else { -4.0 };
    }
    codes
}

fn pose(code: &[f64]) -> Pose {
    Pose::from_wxyz([code[6], code[3], code[4], code[5]], DVec3::new(code[0], code[1], code[2]))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 20))]

    #[test]
    fn gradients(seed in 0u64..1_000_000, scenes in 0usize..3, views in 1usize..4) {
        gradcheck(&[codes(seed, scenes, views)], |x| vec![first_camera_gauge(x[0])]);
        gradcheck(&[codes(seed, scenes, views)], |x| vec![activate(x[0])]);
    }

    #[test]
    fn relative_poses(seed in 0u64..1_000_000) {
        let (scenes, views) = (2, 3);
        let x = codes(seed, scenes, views);
        let tape = Tape::<f64>::new();
        let relative = first_camera_gauge(tape.constant(&x.data, x.shape)).to_vec();
        for (i, found) in relative.chunks(9).enumerate() {
            let expected = pose(&x.data[9 * i..]).relative_to(&pose(&x.data[9 * (i / views * views)..]));
            let found_pose = pose(found);
            prop_assert!(found_pose.rotation.abs_diff_eq(expected.rotation, 1e-12));
            prop_assert!(found_pose.translation.abs_diff_eq(expected.translation, 1e-12));
            prop_assert!(found[6] >= 0.0 && (found[3..7].iter().map(|c| c * c).sum::<f64>() - 1.0).abs() < 1e-12);
            prop_assert_eq!(&found[7..], &x.data[9 * i + 7..9 * i + 9]);
        }
    }

    /// Camera 0 is the identity to the bit, in f32 as well, and passes no gradient of its own pose.
    #[test]
    fn first_camera(seed in 0u64..1_000_000) {
        let x: Vec<f32> = codes(seed, 1, 1).data.iter().map(|x| *x as f32).collect();
        let tape = Tape::<f32>::new();
        let code = tape.leaf(&x, [1, 1, 9]);
        let relative = first_camera_gauge(code);
        prop_assert_eq!(&relative.to_vec()[..7], &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        relative.backward_with(&[1.0; 9]);
        let gradient = code.grad().unwrap();
        prop_assert!(gradient[..7].iter().all(|g| g.abs() < 1e-5), "{:?}", gradient);
        prop_assert_eq!(&gradient[7..], &[1.0, 1.0]);
    }
}

#[test]
fn fields_of_view_are_rectified() {
    let tape = Tape::<f64>::new();
    let code = tape.leaf(&[1.0, -1.0, 0.0, -2.0, 0.5, 0.0, 1.0, -0.3, 0.7], [9]);
    let activated = activate(code);
    assert_eq!(activated.to_vec(), [1.0, -1.0, 0.0, -2.0, 0.5, 0.0, 1.0, 0.0, 0.7]);
    activated.backward_with(&[1.0; 9]);
    assert_eq!(code.grad().unwrap(), [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 1.0]);
}

#[test]
#[should_panic(expected = "camera_head: first_camera_gauge: expected pose codes [B, V, 9], found [2, 9]")]
fn a_wrong_shape_is_refused_with_the_model_path() {
    let tape = Tape::<f64>::new();
    tape.part("camera_head", || first_camera_gauge(tape.constant(&[1.0; 18], [2, 9])));
}

#[test]
#[should_panic(expected = "camera_head: first_camera_gauge: expected pose codes [B, V, 9], found [1, 2, 8]")]
fn a_wrong_width_is_refused_with_the_model_path() {
    let tape = Tape::<f64>::new();
    tape.part("camera_head", || first_camera_gauge(tape.constant(&[1.0; 16], [1, 2, 8])));
}
