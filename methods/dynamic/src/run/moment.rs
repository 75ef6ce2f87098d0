//! A run at one moment of its film, for the viewer.

use crate::run::mixture::Mixture;
use crate::run::{Run, Stage};
use std::collections::BTreeMap;
use weaver_autograd::{Params, Tape};
use weaver_data::film;
use weaver_io::safetensors::Tensors;
use weaver_nn::Context;
use weaver_run::state::take_params;
use weaver_scene::forms::harmonic;
use weaver_scene::{ActivatedGaussians, Gaussians};

impl Mixture {
    /// The Gaussians of an expert at a time, 0 to 1.
    pub fn moment(&self, params: &Params<f32>, expert: usize, time: f64) -> Gaussians {
        let tape = Tape::new();
        tape.without_gradient(|| {
            let at = self.experts()[expert].at(Context::new(&tape, params), time);
            let activated = ActivatedGaussians {
                means: at.means.to_vec(),
                quats: at.quats.to_vec(),
                scales: at.scales.to_vec(),
                opacities: at.opacities.to_vec(),
                sh: at.colors.to_vec().into_iter().map(harmonic).collect(),
                degree: 0,
            };
            activated.to_stored()
        })
    }
}

impl Run {
    /// Makes the scene of a checkpoint of this run at a time, 0 to 1: the expert in training, or else the one trained
    /// last.
    pub fn scenes(&self) -> impl Fn(&Tensors, f64) -> weaver_io::Result<Gaussians> + Sync + use<> {
        let (mixture, params, stages) = (self.mixture.clone(), self.params.clone(), self.settings.stages.clone());
        move |state, time| {
            let stage = state.values::<u64>("place", &[2])?[0] as usize;
            let mut params = params.clone();
            take_params(state, "", &mut params)?;
            Ok(mixture.moment(&params, expert_of(&stages, stage), time))
        }
    }

    /// The expert in training, or else the one trained last.
    pub fn expert_at_hand(&self) -> usize {
        expert_of(&self.settings.stages, self.place().stage)
    }

    /// The present state of an expert, as a function of time, 0 to 1.
    pub fn moments(&self, expert: usize) -> impl Fn(f64) -> Gaussians + Send + Sync + use<> {
        let (mixture, params) = (self.mixture.clone(), self.params.clone());
        move |time| mixture.moment(&params, expert, time)
    }

    /// The photo of each viewpoint taken nearest to a time, 0 to 1.
    pub fn shots_near(&self, time: f64) -> Vec<&film::Shot> {
        let mut nearest: BTreeMap<usize, &film::Shot> = BTreeMap::new();
        for shot in &self.film.shots {
            let best = nearest.entry(shot.viewpoint).or_insert(shot);
            if (shot.time - time).abs() < (best.time - time).abs() {
                *best = shot;
            }
        }
        nearest.into_values().collect()
    }
}

/// The expert of a stage, or of the last earlier stage with one; the first expert if there is none.
fn expert_of(stages: &[Stage], stage: usize) -> usize {
    let expert = |stage: &Stage| match stage {
        Stage::Expert { index, .. } | Stage::Distil { index, .. } => Some(*index),
        Stage::Router { .. } => None,
    };
    stages[..stages.len().min(stage + 1)].iter().rev().find_map(expert).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_router_shows_the_expert_before_it() {
        let stages =
            [Stage::Expert { index: 1, steps: 1 }, Stage::Expert { index: 0, steps: 1 }, Stage::Router { steps: 1 }];
        assert_eq!([0, 1, 2, 3].map(|stage| expert_of(&stages, stage)), [1, 0, 0, 0]);
        assert_eq!(expert_of(&stages[2..], 0), 0);
    }
}
