//! Recovery of paths from pictures of them.

use crate::wall::{self, Moment, PIXELS};
use weaver_autograd::gradcheck::Input;
use weaver_autograd::{Params, Tape, Var};
use weaver_dynamic::{Expert, Keys, KeysConfig, Motion, Poly, Start};
use weaver_losses::metrics::psnr;
use weaver_nn::{AdamW, Builder, Context, Group};
use weaver_splat::{Rasterize, WorkspacePool};

const COUNT: usize = 24;
const STEPS: usize = 900;

fn start_positions() -> Vec<f64> {
    let centered = Input::uniform(1, -1.0, 1.0, [COUNT, 3]).data;
    centered.iter().enumerate().map(|(i, x)| [0.6 * x, 0.4 * x, 2.0 + 0.3 * x][i % 3]).collect()
}

fn image<'t>(
    tape: &'t Tape<f32>,
    pool: &WorkspacePool<f32>,
    (expert, params): (&Expert<f32>, &Params<f32>),
    at: Moment,
) -> Var<'t, f32> {
    let shot = wall::shot(tape, pool, at);
    let [height, width] = shot.size;
    let op = Rasterize::new(width, height, shot.settings, shot.workspaces).without_depth();
    let gaussians = expert.at(Context::new(tape, params), at.time);
    op.apply(&gaussians, &shot.camera, shot.background).image.reshape([PIXELS, 3])
}

/// PSNR of a model trained on pictures of a copy with the `moving` parameters perturbed, at training moments.
fn recovered<M: Motion<f32> + 'static>(build: impl Fn(Builder<'_, f32>, &Start<'_>) -> M, moving: &[&str]) -> f64 {
    let positions = start_positions();
    let start = Start { positions: &positions, sizes: &[0.12; COUNT], opacity: 0.7 };
    let gray = vec![0.5; 3 * COUNT];
    let model = |colors: &[f64]| {
        let mut params = Params::<f32>::new();
        let mut root = Builder::new(&mut params, 0);
        let motion = build(root.scope("m"), &start);
        let expert = Expert::new(root.scope("m"), motion, colors);
        (expert, params)
    };
    let (truth, mut true_params) = model(&Input::uniform(2, 0.1, 0.9, [COUNT, 3]).data);
    for name in moving {
        let id = true_params.find(&format!("m.{name}")).unwrap();
        let values = true_params.value_mut(id);
        let noise = Input::uniform(values.len() as u64, -0.15, 0.15, [values.len()]).data;
        values.iter_mut().zip(noise).for_each(|(x, noise)| *x += noise as f32);
    }
    let (expert, mut params) = model(&gray);
    let moments: Vec<Moment> = [-20.0, 0.0, 20.0]
        .into_iter()
        .flat_map(|angle| (0..12).map(move |frame| Moment { angle, time: f64::from(frame) / 12.0 }))
        .collect();
    let pool = WorkspacePool::new();
    let drawn = |tape: &Tape<f32>, of: (&Expert<f32>, &Params<f32>), at: Moment| {
        tape.without_gradient(|| image(tape, &pool, of, at).to_vec())
    };
    let photos: Vec<Vec<f32>> = moments.iter().map(|at| drawn(&Tape::new(), (&truth, &true_params), *at)).collect();
    let group = Group { params: params.ids().collect(), lr_scale: 1.0, weight_decay: 0.0 };
    let (mut optimizer, mut tape) = (AdamW::new(vec![group], 0.9, 0.99, 1e-15), Tape::new());
    for step in 0..STEPS {
        let which = step * 7 % moments.len();
        {
            let photo = tape.constant(&photos[which], [PIXELS, 3]);
            (image(&tape, &pool, (&expert, &params), moments[which]) - photo).square().mean().backward();
        }
        optimizer.step(&mut params, &mut tape, 0.02 * 0.03_f64.powf(step as f64 / STEPS as f64));
        tape.reset();
    }
    let shown: Vec<f32> = moments.iter().flat_map(|at| drawn(&Tape::new(), (&expert, &params), *at)).collect();
    psnr(&shown, &photos.concat())
}

#[test]
fn cubic_paths_are_found_again() {
    let found = recovered(|b, start| Poly::new(b, start, &[0.5; COUNT]), &["mean", "motion", "spin"]);
    assert!(found > 35.0, "{found}");
}

#[test]
fn keys_are_found_again() {
    let config = KeysConfig { frames: 12, interval: 4, pad: 1.0, margin: 3.0 };
    let found = recovered(|b, start| Keys::new(b, start, config), &["position", "quat"]);
    assert!(found > 35.0, "{found}");
}
