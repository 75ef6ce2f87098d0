//! The operation on the tape.

use crate::scene::Scene;
use proptest::prelude::*;
use weaver_autograd::gradcheck::{Input, Options, gradcheck_with};
use weaver_autograd::{Tape, Var};
use weaver_pose::CameraVars;
use weaver_splat::{GaussianVars, Rasterize, WorkspacePool};

/// The inputs of the operation, features last.
pub fn inputs(scene: &Scene<f64>) -> Vec<Input> {
    let (n, v) = (scene.opacities.len(), scene.views());
    let colors = match scene.degree {
        None => Input::new(&scene.colors, [n, scene.image_channels()]),
        Some(degree) => Input::new(&scene.colors, [n, (degree + 1) * (degree + 1), 3]),
    };
    vec![
        Input::new(&scene.means, [n, 3]),
        Input::new(&scene.quats, [n, 4]),
        Input::new(&scene.scales, [n, 3]),
        Input::new(&scene.opacities, [n]),
        colors,
        Input::new(&scene.viewmats, [v, 3, 4]),
        Input::new(&scene.intrinsics, [v, 4]),
        Input::new(&scene.background, [v, 3]),
        Input::new(&scene.features, [n, scene.channels]),
    ]
}

/// Gaussians, cameras and background.
pub fn named<'t>(x: &[Var<'t, f64>]) -> (GaussianVars<'t, f64>, CameraVars<'t, f64>, Var<'t, f64>) {
    let gaussians = GaussianVars { means: x[0], quats: x[1], scales: x[2], opacities: x[3], colors: x[4] };
    (gaussians, CameraVars { viewmats: x[5], intrinsics: x[6] }, x[7])
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 20, failure_persistence: None, ..Default::default() })]

    #[test]
    fn passes_gradcheck(
        seed: u64,
        n in 0_usize..5,
        views in 1_usize..3,
        size in (1_usize..5, 1_usize..5),
        degree in prop::option::of(0_usize..=4),
        antialiased: bool,
    ) {
        let mut scene = Scene::smooth(seed, n, views, size, degree);
        scene.settings.antialiased = antialiased;
        let workspaces = WorkspacePool::new();
        // Means in place of scales would be another scene, and not a smooth one.
        let options = Options { duplicates: false, seed, ..Options::default() };
        gradcheck_with(options, &inputs(&scene)[..8], |x| {
            let (gaussians, cameras, background) = named(x);
            let drawn = Rasterize::new(size.0, size.1, scene.settings, &workspaces).apply(&gaussians, &cameras, background);
            vec![drawn.image, drawn.alpha, drawn.depth, drawn.expected_depth()]
        });
    }

    /// Features beside colors or instead of them, with depth or without.
    #[test]
    fn features_pass_gradcheck(
        seed: u64,
        n in 0_usize..5,
        views in 1_usize..3,
        size in (1_usize..5, 1_usize..5),
        degree in prop::option::of(0_usize..=2),
        channels in prop::sample::select(vec![0_usize, 1, 5]),
        colorless: bool,
        depth: bool,
    ) {
        let mut scene = Scene::smooth(seed, n, views, size, degree).with_channels(channels);
        if colorless {
            scene = scene.without_colors();
        }
        let workspaces = WorkspacePool::new();
        let options = Options { duplicates: false, seed, ..Options::default() };
        gradcheck_with(options, &inputs(&scene), |x| {
            let (gaussians, cameras, background) = named(x);
            let op = Rasterize::new(size.0, size.1, scene.settings, &workspaces);
            let op = if depth { op } else { op.without_depth() };
            let (drawn, features) = op.apply_with_features(&gaussians, &cameras, background, x[8]);
            let mut out = vec![drawn.image, drawn.alpha, features];
            out.extend(depth.then_some(drawn.depth));
            out
        });
    }
}

/// The tape's outputs equal the plain function's; outputs that are not requested are absent.
#[test]
fn equals_the_plain_function() {
    let scene = Scene::random(3, 30, 2, (20, 15), Some(1)).with_channels(5);
    let planes = scene.render();
    let (tape, workspaces) = (Tape::<f64>::new(), WorkspacePool::new());
    let x: Vec<_> = inputs(&scene).iter().map(|input| tape.leaf(&input.data, input.shape)).collect();
    let (gaussians, cameras, background) = named(&x);
    let op = || Rasterize::new(20, 15, scene.settings, &workspaces);
    let (drawn, features) = op().apply_with_features(&gaussians, &cameras, background, x[8]);
    assert_eq!(drawn.image.to_vec(), planes.image);
    assert_eq!((drawn.alpha.to_vec(), drawn.depth.to_vec()), (planes.alpha.clone(), planes.depth.clone()));
    assert_eq!((features.shape().dims(), features.to_vec()), ([2, 15, 20, 5].as_slice(), planes.features));
    let mut expected = vec![f64::NAN; planes.alpha.len()];
    weaver_splat::expected_depth(&planes.depth, &planes.alpha, &mut expected);
    assert_eq!(drawn.expected_depth().to_vec(), expected);
    let flat = op().without_depth().apply(&gaussians, &cameras, background);
    assert_eq!((flat.image.to_vec(), flat.depth.shape().dims()), (planes.image, [0].as_slice()));
    let bare = GaussianVars { colors: tape.leaf(&[], [30, 0]), ..gaussians };
    let (drawn, own) = op().apply_with_features(&bare, &cameras, background, x[8]);
    assert_eq!((drawn.image.shape().dims(), own.to_vec()), ([2, 15, 20, 0].as_slice(), features.to_vec()));
}

/// Pixels that see nothing have expected depth 0, and pass nothing back.
#[test]
fn expected_depth_of_nothing_is_zero() {
    let mut scene = Scene::random(1, 1, 1, (4, 4), None);
    scene.means.fill(-1.0);
    let tape = Tape::<f64>::new();
    let x: Vec<_> = inputs(&scene).iter().map(|input| tape.leaf(&input.data, input.shape)).collect();
    let (gaussians, cameras, background) = named(&x);
    let drawn = Rasterize::new(4, 4, scene.settings, &WorkspacePool::new()).apply(&gaussians, &cameras, background);
    let expected = drawn.expected_depth();
    assert_eq!(expected.to_vec(), [0.0; 16]);
    expected.sum().backward();
    assert_eq!(x[0].grad().unwrap(), [0.0; 3]);
}

/// Two renders on one tape keep their states apart, steps repeat, and memory comes back.
#[test]
fn steps_repeat_in_the_same_memory() {
    let scenes = [Scene::random(1, 60, 2, (20, 15), Some(1)), Scene::random(2, 40, 1, (20, 15), None)];
    let workspaces = WorkspacePool::new();
    let mut tape = Tape::<f64>::new();
    let mut first = None;
    let mut bytes = Vec::new();
    for _ in 0..3 {
        let mut leaves = Vec::new();
        let mut total = tape.scalar(0.0);
        for scene in &scenes {
            let x: Vec<_> = inputs(scene)[..8].iter().map(|input| tape.leaf(&input.data, input.shape)).collect();
            let (gaussians, cameras, background) = named(&x);
            let drawn = Rasterize::new(20, 15, scene.settings, &workspaces).apply(&gaussians, &cameras, background);
            assert_eq!(drawn.image.to_vec(), scene.render().image);
            assert!(drawn.counts.to_vec()[0] > 0.0);
            total = total + drawn.image.square().sum() + drawn.depth.sum();
            leaves.extend(x);
        }
        total.backward();
        let gradients: Vec<_> = leaves.iter().map(|leaf| leaf.grad().unwrap()).collect();
        assert_eq!(first.get_or_insert_with(|| gradients.clone()), &gradients);
        tape.reset();
        bytes.push(tape.pool().allocated_bytes());
    }
    assert_eq!(bytes[1], bytes[2]);
}

#[test]
fn misfits_are_shape_errors() {
    let scene = Scene::random(1, 4, 1, (5, 5), None);
    let tape = Tape::<f64>::new();
    let mut inputs = inputs(&scene);
    inputs.pop();
    inputs[4] = Input::new(&[0.0; 4 * 2 * 3], [4, 2, 3]);
    let vars: Vec<_> = inputs.iter().map(|input| tape.leaf(&input.data, input.shape)).collect();
    let op = Rasterize::new(5, 5, scene.settings, &WorkspacePool::new());
    let error = tape.try_apply(op, &vars).unwrap_err().to_string();
    assert!(error.contains("rasterize") && error.contains("K of 1, 4, 9, 16, 25"), "{error}");
}
