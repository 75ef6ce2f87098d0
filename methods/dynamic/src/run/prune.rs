//! A run with fewer Gaussians.

use crate::run::{Run, RunError};
use crate::{Score, best, scores};
use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;
use weaver_autograd::ParamId;
use weaver_io::safetensors::Tensors;
use weaver_kernels::random::Stream;

/// Criterion for keeping Gaussians.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum KeepBy {
    /// Their share of the pictures, times the gate ([`Score::Contribution`]).
    #[default]
    Contribution,
    /// The gate's dependence on them, as published ([`Score::Sensitivity`]).
    Sensitivity,
    /// Chance, as a control.
    Chance,
}

impl KeepBy {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Contribution => "contribution",
            Self::Sensitivity => "sensitivity",
            Self::Chance => "chance",
        }
    }
}

impl fmt::Display for KeepBy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for KeepBy {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let all = [Self::Contribution, Self::Sensitivity, Self::Chance];
        let names = all.map(Self::name).join(", ");
        all.into_iter().find(|by| by.name() == text).ok_or_else(|| format!("expected one of {names}"))
    }
}

impl Run {
    /// All parameters without the Gaussians of the lowest scores over the training photos: the share `keep` stays, at
    /// least one of each expert. `observe` receives the numbers of finished and of all photos.
    ///
    /// # Errors
    /// When the share is not above 0 and at most 1, or the rasterizer refuses.
    pub fn pruned(&self, keep: f64, by: KeepBy, mut observe: impl FnMut(usize, usize)) -> Result<Tensors, RunError> {
        if !(keep > 0.0 && keep <= 1.0) {
            return Err(RunError::setting("keep", "above 0, at most 1", keep));
        }
        let all = self.mixture.router().rows().iter().map(Vec::len).sum();
        let mut worth = vec![0.0; all];
        let score = match by {
            KeepBy::Chance => {
                let stream = Stream::new(self.settings.seed, 0, "dynamic.prune");
                worth = (0..all as u64).map(|i| stream.uniform::<f64>(i)).collect();
                None
            }
            KeepBy::Contribution => Some(Score::Contribution),
            KeepBy::Sensitivity => Some(Score::Sensitivity),
        };
        let shots = self.training();
        for (done, shot) in shots.iter().map(|i| &self.film.shots[*i]).enumerate() {
            let Some(score) = score else { break };
            let of_shot = scores(self.mixture.router(), &self.params, score, &|cx| {
                (self.mixture.list(cx, shot.time), self.mixture.shot(cx.tape, &shot.camera, shot.time))
            });
            self.mixture.check()?;
            worth.iter_mut().zip(of_shot).for_each(|(sum, x)| *sum += x);
            observe(done + 1, shots.len());
        }
        Ok(self.with_rows(&kept(&worth, keep, self.mixture.counts())))
    }

    /// All parameters, with only some rows of each expert.
    fn with_rows(&self, kept: &[Vec<u32>]) -> Tensors {
        let mut tensors = self.tensors();
        let (experts, router) = self.mixture.rows();
        let mut rows: BTreeMap<ParamId, Vec<u32>> = BTreeMap::new();
        let mut list = Vec::new();
        let mut first = 0;
        for ((ids, kept), count) in experts.iter().zip(kept).zip(self.mixture.counts()) {
            rows.extend(ids.iter().map(|id| (*id, kept.clone())));
            list.extend(kept.iter().map(|row| first + row));
            first += *count as u32;
        }
        rows.extend(router.map(|id| (id, list.clone())));
        for (id, rows) in rows {
            let param = self.params.get(id);
            let shape = param.shape().with_axis(0, rows.len());
            let width = shape.len() / rows.len().max(1);
            let values: Vec<f32> =
                rows.iter().flat_map(|row| param.value()[*row as usize * width..][..width].iter().copied()).collect();
            tensors.insert(param.name(), shape.dims(), values);
        }
        tensors
    }
}

/// The kept rows of each expert, best of the whole list first; the best of an expert that would have none.
fn kept(worth: &[f64], keep: f64, counts: &[usize]) -> Vec<Vec<u32>> {
    let all = best(worth, keep);
    let mut first = 0;
    counts
        .iter()
        .map(|count| {
            let range = first..first + *count as u32;
            first = range.end;
            let own: Vec<u32> = all.iter().filter(|row| range.contains(row)).map(|row| row - range.start).collect();
            if !own.is_empty() {
                return own;
            }
            let of = &worth[range.start as usize..range.end as usize];
            let top = (0..of.len()).fold(0, |top, i| if of[i] > of[top] { i } else { top });
            vec![top as u32]
        })
        .collect()
}
