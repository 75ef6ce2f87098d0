//! A router trained on the wall.

use crate::wall::{self, Moment, PIXELS, Right, SIZE};
use weaver_autograd::{Params, Tape};
use weaver_dynamic::{PixelRouter, RouterConfig, photometric};
use weaver_nn::{Builder, Context, RAdam};
use weaver_splat::WorkspacePool;

/// Trained numbers of a Gaussian beside Phi.
#[derive(Clone, Copy, PartialEq)]
pub enum Trained {
    All,
    /// Neither the numbers of directions nor of time.
    Weights,
}

/// All cameras at all times.
pub fn shots(angles: &[f64], times: &[f64]) -> Vec<Moment> {
    angles.iter().flat_map(|angle| times.iter().map(|time| Moment { angle: *angle, time: *time })).collect()
}

pub struct Routed {
    params: Params<f32>,
    router: PixelRouter,
    workspaces: WorkspacePool<f32>,
}

impl Routed {
    pub fn trained(right: Right, shots: &[Moment], steps: usize, which: Trained) -> Self {
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
    pub fn shown(&self, right: Right, at: Moment) -> [Vec<f32>; 3] {
        let tape = Tape::new();
        let shot = wall::shot(&tape, &self.workspaces, at);
        let gaussians = wall::experts(&tape, right, at);
        let gated = self.router.gated(Context::new(&tape, &self.params), &gaussians, &shot);
        [gated.images.to_vec(), gated.gate.to_vec(), wall::photo(&shot)]
    }
}
