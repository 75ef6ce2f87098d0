//! Experts that are right on half of the picture, of the clip, of the cameras: what the router needs to know it, and that no blend passes its bound.

use crate::wall::{self, Moment, PIXELS, Right, SIZE};
use weaver_autograd::{Params, Tape};
use weaver_dynamic::{PixelRouter, RouterConfig, blend, convex_oracle, hard_oracle, photometric};
use weaver_nn::{Builder, Context, RAdam};
use weaver_splat::WorkspacePool;

/// Numbers of a Gaussian that are trained beside Phi.
#[derive(Clone, Copy, PartialEq)]
enum Trained {
    All,
    /// Neither those of directions nor those of time.
    Weights,
}

/// Moments that are trained on, and others.
struct Shots {
    training: Vec<Moment>,
    held_out: Vec<Moment>,
}

/// All cameras at all times.
fn shots(angles: &[f64], times: &[f64]) -> Vec<Moment> {
    angles.iter().flat_map(|angle| times.iter().map(|time| Moment { angle: *angle, time: *time })).collect()
}

struct Routed {
    params: Params<f32>,
    router: PixelRouter,
    workspaces: WorkspacePool<f32>,
}

impl Routed {
    fn trained(right: Right, shots: &[Moment], steps: usize, which: Trained) -> Self {
        let mut params = Params::new();
        let router = PixelRouter::new(Builder::new(&mut params, 1), &wall::owners(), RouterConfig::default());
        let (base, time) = (router.base(), router.time());
        let ids = params.ids().filter(|id| which == Trained::All || *id != time).collect();
        let mut optimizer = RAdam::new(ids, 0.9, 0.999, 1e-8);
        let (mut tape, workspaces) = (Tape::new(), WorkspacePool::new());
        for step in 0..steps {
            {
                let at = shots[step * 7 % shots.len()];
                let shot = wall::shot(&tape, &workspaces, at);
                let photo = tape.constant(&wall::photo(&shot), [PIXELS, 3]);
                let gaussians = wall::experts(&tape, right, at);
                let image = router.gated(Context::new(&tape, &params), &gaussians, &shot).image;
                photometric(image, photo, SIZE).backward();
            }
            optimizer.step(&mut params, &mut tape, |id| if id == base { 0.5 } else { 0.05 });
            if which == Trained::Weights {
                params.value_mut(base).chunks_mut(2).for_each(|row| row[1] = 0.9);
            }
            tape.reset();
        }
        Self { params, router, workspaces }
    }

    /// The experts' pictures, the gate, and the photo.
    fn shown(&self, right: Right, at: Moment) -> [Vec<f32>; 3] {
        let tape = Tape::new();
        let shot = wall::shot(&tape, &self.workspaces, at);
        let gaussians = wall::experts(&tape, right, at);
        let gated = self.router.gated(Context::new(&tape, &self.params), &gaussians, &shot);
        [gated.images.to_vec(), gated.gate.to_vec(), wall::photo(&shot)]
    }

    /// The share of pixels at which the gate's first is the best expert.
    fn right(&self, right: Right, shots: &[Moment]) -> f64 {
        let of = |at: &Moment| {
            let [images, gate, photo] = self.shown(right, *at);
            let best = hard_oracle(&images, &photo);
            (0..PIXELS).filter(|i| usize::from(gate[PIXELS + i] > gate[*i]) == best[*i]).count()
        };
        shots.iter().map(of).sum::<usize>() as f64 / (PIXELS * shots.len()) as f64
    }
}

const TIMES: [f64; 6] = [0.0, 0.15, 0.3, 0.55, 0.7, 0.85];

/// Promise (results): experts that are right on half of the picture, of the clip, of the cameras are believed there;
/// time and cameras need the numbers made for them; no gate passes the best convex blend.
#[test]
fn half_of_the_picture_needs_weights_alone() {
    let shots = shots(&[-20.0, 0.0, 20.0], &[0.25, 0.75]);
    let routed = Routed::trained(wall::left, &shots, 60, Trained::Weights);
    let share = routed.right(wall::left, &shots);
    assert!(share > 0.9, "{share}");
}

/// Promise of `half_of_the_picture_needs_weights_alone`.
#[test]
fn half_of_the_clip_needs_time() {
    let shots = Shots { training: shots(&[-20.0, 20.0], &TIMES), held_out: shots(&[0.0], &[0.1, 0.2, 0.65, 0.9]) };
    let [all, alone] = [Trained::All, Trained::Weights].map(|which| {
        let routed = Routed::trained(wall::early, &shots.training, 240, which);
        routed.right(wall::early, &shots.held_out)
    });
    // Where nothing depends on time, each pixel is right at half of the moments.
    assert!(all > 0.9 && (alone - 0.5).abs() < 1e-9, "{all} {alone}");
}

/// Promise of `half_of_the_picture_needs_weights_alone`.
#[test]
fn half_of_the_cameras_needs_directions() {
    let angles = [-36.0, -24.0, -8.0, 8.0, 24.0, 36.0];
    let shots = Shots { training: shots(&angles, &[0.0]), held_out: shots(&[-30.0, 30.0], &[0.0]) };
    let [all, alone] = [Trained::All, Trained::Weights].map(|which| {
        let routed = Routed::trained(wall::from_the_left, &shots.training, 240, which);
        routed.right(wall::from_the_left, &shots.held_out)
    });
    assert!(all > 0.9 && alone < 0.65, "{all} {alone}");
}

/// Squared errors at each pixel: the best convex blend's is the least, whatever the gate.
///
/// Promise of `half_of_the_picture_needs_weights_alone`.
#[test]
fn no_gate_passes_the_best_convex_blend() {
    let shots = shots(&[-20.0, 0.0, 20.0], &[0.25, 0.75]);
    for steps in [0, 10, 40] {
        let routed = Routed::trained(wall::left, &shots, steps, Trained::All);
        for at in &shots {
            let [images, gate, photo] = routed.shown(wall::left, *at);
            let gate: Vec<f64> = gate.into_iter().map(f64::from).collect();
            let sum: Vec<f64> = (0..PIXELS).map(|i| gate[i] + gate[PIXELS + i]).collect();
            let gate: Vec<f64> = gate.iter().enumerate().map(|(i, share)| share / sum[i % PIXELS]).collect();
            let errors = |shares: &[f64]| {
                let image = blend(&images, shares, PIXELS);
                let squares: Vec<f64> = image.iter().zip(&photo).map(|(a, b)| (a - f64::from(*b)).powi(2)).collect();
                squares.chunks(3).map(|rgb| rgb.iter().sum()).collect::<Vec<f64>>()
            };
            let hard = hard_oracle(&images, &photo);
            let hard: Vec<f64> = (0..2 * PIXELS).map(|i| f64::from(u8::from(hard[i % PIXELS] == i / PIXELS))).collect();
            let (bound, ours, hard) = (errors(&convex_oracle(&images, &photo)), errors(&gate), errors(&hard));
            for ((bound, ours), hard) in bound.iter().zip(ours).zip(hard) {
                assert!(*bound <= ours + 1e-12 && *bound <= hard + 1e-12, "{bound} {ours} {hard}");
            }
        }
    }
}
