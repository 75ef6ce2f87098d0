//! The router: equal logits, gradients, experts that are right in places, and scores of Gaussians.

use weaver_autograd::gradcheck::Input;
use weaver_autograd::{Params, Real, Tape};
use weaver_dynamic::{PixelRouter, RouterConfig, Score, Shot, best, distillation, photometric, scores};
use weaver_nn::{AdamW, Builder, Context, Group};
use weaver_pose::CameraVars;
use weaver_splat::{GaussianVars, RasterSettings, WorkspacePool};

const SIZE: [usize; 2] = [12, 16];
const PIXELS: usize = SIZE[0] * SIZE[1];

/// A wall of Gaussians at depth 2 for each of two experts, colors and owners of the whole list; interleaved.
struct World {
    means: Vec<f64>,
    colors: Vec<f64>,
    owners: Vec<usize>,
}

impl World {
    /// `color` is an expert's color at x, y of the wall.
    fn new(color: impl Fn(usize, f64, f64) -> [f64; 3]) -> Self {
        let (mut means, mut colors, mut owners) = (Vec::new(), Vec::new(), Vec::new());
        for (row, column) in (0..7).flat_map(|row| (0..9).map(move |column| (row, column))) {
            for expert in 0..2 {
                let (x, y) = (0.25 * f64::from(column) - 1.0, 0.25 * f64::from(row) - 0.75);
                means.extend([x, y, 2.0 + 0.001 * expert as f64]);
                colors.extend(color(expert, x, y));
                owners.push(expert);
            }
        }
        Self { means, colors, owners }
    }

    fn drawn<'a, 't, T: Real>(
        &self,
        tape: &'t Tape<T>,
        workspaces: &'a WorkspacePool<T>,
        time: f64,
    ) -> (GaussianVars<'t, T>, Shot<'a, 't, T>) {
        let n = self.owners.len();
        let of = |values: &[f64], width: usize| {
            tape.constant(&values.iter().map(|x| T::from_f64(*x)).collect::<Vec<_>>(), [n, width])
        };
        let gaussians = GaussianVars {
            means: of(&self.means, 3),
            quats: of(&[1.0, 0.0, 0.0, 0.0].repeat(n), 4),
            scales: of(&vec![0.12; 3 * n], 3),
            opacities: of(&vec![0.9; n], 1).reshape([n]),
            colors: of(&self.colors, 3),
        };
        let numbers = |values: &[f64]| values.iter().map(|x| T::from_f64(*x)).collect::<Vec<_>>();
        let shot = Shot {
            camera: CameraVars {
                viewmats: tape
                    .constant(&numbers(&[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]), [1, 3, 4]),
                intrinsics: tape.constant(&numbers(&[16.0, 16.0, 8.0, 6.0]), [1, 4]),
            },
            time,
            size: SIZE,
            background: tape.constant(&numbers(&[0.1, 0.2, 0.3]), [3]),
            settings: RasterSettings::default(),
            workspaces,
        };
        (gaussians, shot)
    }
}

/// One expert red where x is negative, the other where it is positive; both wrong elsewhere.
fn halves() -> World {
    World::new(|expert, x, _| if (x < 0.0) == (expert == 0) { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] })
}

/// Promise (results): the router of a mixture: equal experts share equally, gradients, an expert that is right on one
/// half is believed there, invisible Gaussians are worth nothing.
#[test]
fn equal_experts_share_equally() {
    let world = World::new(|_, x, y| [0.5 + 0.4 * x, 0.5 + 0.4 * y, 0.5]);
    // Both experts have the same geometry, and carry the background's values.
    let world = World { means: world.means.chunks(3).flat_map(|m| [m[0], m[1], 2.0]).collect(), ..world };
    let config = RouterConfig { background_weight: 0.9, ..RouterConfig::default() };
    let mut params = Params::<f64>::new();
    let router = PixelRouter::new(Builder::new(&mut params, 3), &world.owners, config);
    let (tape, workspaces) = (Tape::new(), WorkspacePool::new());
    let (gaussians, shot) = world.drawn(&tape, &workspaces, 0.5);
    let gated = router.gated(Context::new(&tape, &params), &gaussians, &shot);
    assert!(gated.gate.to_vec().iter().all(|g| (g - 0.5).abs() < 1e-15));
    let images = gated.images.to_vec();
    let (one, mixture) = (&images[..3 * PIXELS], gated.image.to_vec());
    assert!(one.iter().zip(mixture).all(|(a, b)| (a - b).abs() < 1e-14));
}

/// Promise of `equal_experts_share_equally`.
#[test]
fn gradients_equal_differences() {
    let world = halves();
    let mut params = Params::<f64>::new();
    let router = PixelRouter::new(Builder::new(&mut params, 3), &world.owners, RouterConfig::default());
    for id in params.ids().collect::<Vec<_>>() {
        let noise = Input::uniform(params.get(id).value().len() as u64, -0.3, 0.3, params.get(id).shape()).data;
        params.value_mut(id).iter_mut().zip(noise).for_each(|(x, n)| *x += n);
    }
    let target = Input::uniform(9, 0.0, 1.0, [PIXELS, 3]).data;
    let loss = |params: &Params<f64>, backward: Option<&mut Vec<Vec<f64>>>| {
        let (tape, workspaces) = (Tape::new(), WorkspacePool::new());
        let (gaussians, shot) = world.drawn(&tape, &workspaces, 0.4);
        let gated = router.gated(Context::new(&tape, params), &gaussians, &shot);
        let loss = photometric(gated.image, tape.constant(&target, [PIXELS, 3]), SIZE);
        if let Some(gradients) = backward {
            loss.backward();
            *gradients = params.ids().map(|id| tape.param_grad(id).expect("a gradient").to_vec()).collect();
        }
        loss.item()
    };
    let mut gradients = Vec::new();
    loss(&params, Some(&mut gradients));
    for (id, gradient) in params.ids().zip(gradients) {
        for i in (0..gradient.len()).step_by(gradient.len() / 7 + 1) {
            let shifted = |by: f64| {
                let mut other = params.clone();
                other.value_mut(id)[i] += by;
                loss(&other, None)
            };
            let difference = (shifted(1e-5) - shifted(-1e-5)) / 2e-5;
            let name = params.get(id).name();
            assert!((difference - gradient[i]).abs() < 1e-8, "{name}[{i}]: {difference} {}", gradient[i]);
        }
    }
}

/// Trains a router for some steps on one picture; returns the share of pixels with a right first choice of the gate.
fn right(world: &World, truth: impl Fn(usize) -> [f64; 3], first: impl Fn(usize) -> bool) -> f64 {
    let mut params = Params::<f32>::new();
    let router = PixelRouter::new(Builder::new(&mut params, 3), &world.owners, RouterConfig::default());
    let group = Group { params: params.ids().collect(), lr_scale: 1.0, weight_decay: 0.0 };
    let mut optimizer = AdamW::new(vec![group], 0.9, 0.999, 1e-8);
    let target: Vec<f32> = (0..PIXELS).flat_map(truth).map(|x| x as f32).collect();
    let (mut tape, workspaces) = (Tape::new(), WorkspacePool::new());
    let mut found = 0.0;
    for _ in 0..60 {
        {
            let (gaussians, shot) = world.drawn(&tape, &workspaces, 0.5);
            let gated = router.gated(Context::new(&tape, &params), &gaussians, &shot);
            let gate = gated.gate.to_vec();
            let right = (0..PIXELS).filter(|i| (gate[*i] > 0.5) == first(*i)).count();
            found = right as f64 / PIXELS as f64;
            photometric(gated.image, tape.constant(&target, [PIXELS, 3]), SIZE).backward();
        }
        optimizer.step(&mut params, &mut tape, 0.2);
        tape.reset();
    }
    found
}

/// On its half of the picture, the router trusts the right expert.
///
/// Promise of `equal_experts_share_equally`.
#[test]
fn experts_win_where_they_are_right() {
    let left = |i: usize| i % SIZE[1] < SIZE[1] / 2;
    let share = right(&halves(), |_| [1.0, 0.0, 0.0], left);
    assert!(share > 0.9, "{share}");
}

/// Promise of `equal_experts_share_equally`.
#[test]
fn what_is_out_of_sight_is_worth_nothing() {
    let mut world = halves();
    let hidden = 6;
    world.means[3 * hidden + 2] = -3.0;
    let mut params = Params::<f64>::new();
    let router = PixelRouter::new(Builder::new(&mut params, 3), &world.owners, RouterConfig::default());
    let workspaces = WorkspacePool::new();
    for score in [Score::Contribution, Score::Sensitivity] {
        let found = scores(&router, &params, score, &|cx| world.drawn(cx.tape, &workspaces, 0.4));
        assert_eq!(found.len(), world.owners.len());
        assert_eq!(found[hidden], 0.0);
        assert!(found.iter().filter(|score| **score > 0.0).count() > world.owners.len() / 2, "{score:?}");
        assert!(!best(&found, 0.9).contains(&(hidden as u32)));
    }
    // The sum of all scores: the mixture's whole light.
    let (tape, workspaces) = (Tape::new(), WorkspacePool::new());
    let (gaussians, shot) = world.drawn(&tape, &workspaces, 0.4);
    let gated = router.gated(Context::new(&tape, &params), &gaussians, &shot);
    let light: f64 = gated.gate.to_vec().iter().zip(gated.alphas.to_vec()).map(|(g, a)| g * a).sum();
    let found = scores(&router, &params, Score::Contribution, &|cx| world.drawn(cx.tape, &workspaces, 0.4));
    assert!((found.iter().sum::<f64>() - light).abs() < 1e-9);
}

#[test]
fn the_best_are_kept_in_their_order() {
    assert_eq!(best(&[0.0, 3.0, 1.0, 3.0, 2.0], 0.6), [1, 3, 4]);
    assert_eq!(best(&[1.0; 4], 0.5), [0, 1]);
    assert_eq!(best(&[f64::NAN, 1.0], 1.0), [0, 1]);
}

#[test]
#[should_panic(expected = "a share above 0 and at most 1, found 0")]
fn a_share_of_nothing_is_refused() {
    best(&[1.0], 0.0);
}

/// With a gate of one and all weight on photos, distillation is training.
#[test]
fn distillation_with_a_gate_of_one_is_training() {
    let tape = Tape::<f64>::new();
    let image = |seed: u64| tape.constant(&Input::uniform(seed, 0.0, 1.0, [PIXELS, 3]).data, [PIXELS, 3]);
    let (expert, photo, mixture) = (image(1), image(2), image(3));
    let gate = tape.constant(&[1.0; PIXELS], [PIXELS]);
    let found = distillation(expert, gate, [photo, mixture], 1.0, SIZE).item();
    assert!((found - photometric(expert, photo, SIZE).item()).abs() < 1e-15);
    let half = tape.constant(&[0.5; PIXELS], [PIXELS]);
    assert_ne!(distillation(expert, half, [photo, mixture], 0.5, SIZE).item(), found);
}

#[test]
#[should_panic(expected = "every expert has Gaussians")]
fn an_expert_without_gaussians_is_refused() {
    let mut params = Params::<f32>::new();
    PixelRouter::new(Builder::new(&mut params, 0), &[0, 2, 2], RouterConfig::default());
}
