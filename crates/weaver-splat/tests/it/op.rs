//! The operation on the tape.

use crate::scene::Scene;
use proptest::prelude::*;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, Options, gradcheck_with};
use weaver_splat::{CameraVars, GaussianVars, Rasterize, WorkspacePool};

fn inputs(scene: &Scene<f64>) -> Vec<Input> {
    let (n, v) = (scene.opacities.len(), scene.views());
    let colours = match scene.degree {
        None => Input::new(&scene.colours, [n, 3]),
        Some(degree) => Input::new(&scene.colours, [n, (degree + 1) * (degree + 1), 3]),
    };
    vec![
        Input::new(&scene.means, [n, 3]),
        Input::new(&scene.quats, [n, 4]),
        Input::new(&scene.scales, [n, 3]),
        Input::new(&scene.opacities, [n]),
        colours,
        Input::new(&scene.viewmats, [v, 3, 4]),
        Input::new(&scene.intrinsics, [v, 4]),
        Input::new(&scene.background, [v, 3]),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]

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
        gradcheck_with(options, &inputs(&scene), |x| {
            let gaussians =
                GaussianVars { means: x[0], quats: x[1], scales: x[2], opacities: x[3], colours: x[4] };
            let cameras = CameraVars { viewmats: x[5], intrinsics: x[6], background: x[7] };
            let drawn = Rasterize::new(size.0, size.1, scene.settings, &workspaces).apply(&gaussians, &cameras);
            vec![drawn.image, drawn.alpha, drawn.depth]
        });
    }
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
            let x: Vec<_> = inputs(scene).iter().map(|input| tape.leaf(&input.data, input.shape)).collect();
            let gaussians = GaussianVars { means: x[0], quats: x[1], scales: x[2], opacities: x[3], colours: x[4] };
            let cameras = CameraVars { viewmats: x[5], intrinsics: x[6], background: x[7] };
            let drawn = Rasterize::new(20, 15, scene.settings, &workspaces).apply(&gaussians, &cameras);
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
    inputs[4] = Input::new(&[0.0; 4 * 2 * 3], [4, 2, 3]);
    let vars: Vec<_> = inputs.iter().map(|input| tape.leaf(&input.data, input.shape)).collect();
    let op = Rasterize::new(5, 5, scene.settings, &WorkspacePool::new());
    let error = tape.try_apply(op, &vars).unwrap_err().to_string();
    assert!(error.contains("rasterize") && error.contains("K of 1, 4, 9, 16, 25"), "{error}");
}
