//! Losses of score curves. Batches have their normal half first.

use crate::top_k::top_k;
use crate::urdmu::length;
use weaver_autograd::ops::{binary_cross_entropy, mean_at_top_k, top_k_mean};
use weaver_autograd::{Real, Var};

/// Targets of a batch of `2 b` videos: 0 for the normal half, 1 for the other.
fn bag_labels<T: Real>(videos: Var<'_, T>) -> Var<'_, T> {
    let half = videos.shape()[0] / 2;
    videos.tape().constant_with(videos.shape(), |y| {
        y[..half].fill(T::ZERO);
        y[half..].fill(T::ONE);
    })
}

/// The abnormal half of a batch.
pub(crate) fn abnormal<T: Real>(scores: Var<'_, T>) -> Var<'_, T> {
    let half = scores.shape()[0] / 2;
    scores.slice(0, half, scores.shape()[0] - half)
}

/// Binary cross entropy of the mean of each video's k largest scores, k = T / 16 + 1.
///
/// scores `[2 b, T]` gives a scalar. Differentiable.
pub fn bag_loss<T: Real>(scores: Var<'_, T>) -> Var<'_, T> {
    let videos = top_k_mean(scores, top_k(scores.shape()[1]));
    binary_cross_entropy(videos, bag_labels(videos))
}

/// Binary cross entropy of the means of each class's k largest scores against `labels` `[2 b, C]`, constant.
///
/// class scores `[2 b, T, C]` gives a scalar. Differentiable in the scores.
pub fn class_loss<'t, T: Real>(class_scores: Var<'t, T>, labels: Var<'t, T>) -> Var<'t, T> {
    let by_class = class_scores.permute(&[0, 2, 1]);
    binary_cross_entropy(top_k_mean(by_class, top_k(class_scores.shape()[1])), labels)
}

/// The mean over videos of `sum over t of (s_(t+1) - s_t)^2`, scores `[B, T]`. Differentiable.
pub fn smoothness<T: Real>(scores: Var<'_, T>) -> Var<'_, T> {
    let time = scores.shape()[1];
    let step = scores.slice(1, 1, time - 1) - scores.slice(1, 0, time - 1);
    step.square().sum_axis(1).mean()
}

/// The mean over videos of `sum over t of s_t`, scores `[B, T]`. Differentiable.
pub fn sparsity<T: Real>(scores: Var<'_, T>) -> Var<'_, T> {
    scores.sum_axis(1).mean()
}

/// Binary cross entropy of the scores `[b, T]` of abnormal videos against labels of their snippets `[b, T]`, over
/// videos with a label above 0; 0 if there are none. Differentiable in the scores; labels are constant.
pub fn snippet_loss<'t, T: Real>(scores: Var<'t, T>, labels: &[T]) -> Var<'t, T> {
    let time = scores.shape()[1];
    let labeled: Vec<u32> = (0..scores.shape()[0])
        .filter(|b| labels[b * time..(b + 1) * time].iter().any(|y| *y > T::ZERO))
        .map(|b| b as u32)
        .collect();
    if labeled.is_empty() {
        return scores.tape().scalar(T::ZERO);
    }
    let y: Vec<T> = labeled.iter().flat_map(|b| &labels[*b as usize * time..][..time]).copied().collect();
    binary_cross_entropy(scores.gather_rows(&labeled), scores.tape().constant(&y, [labeled.len(), time]))
}

/// Weight of smoothness and sparsity in the splatting loss.
pub const CURVE_WEIGHT: f64 = 8e-5;

/// Splatting's addition to [`bag_loss`]: [`snippet_loss`] with the labels, if given, and [`smoothness`] and
/// [`sparsity`], both times [`CURVE_WEIGHT`], of the abnormal half of `scores` `[2 b, T]`.
///
/// D'Amicantonio et al., arXiv 2508.06318, equation 6.
pub fn curve_loss<'t, T: Real>(scores: Var<'t, T>, labels: Option<&[T]>) -> Var<'t, T> {
    let scores = abnormal(scores);
    let shape = (smoothness(scores) + sparsity(scores)) * CURVE_WEIGHT;
    match labels {
        Some(labels) => shape + snippet_loss(scores, labels),
        None => shape,
    }
}

/// DeepMIL's ranking loss: `max(0, 1 - max s_a + max s_n)`, the i-th normal video against the i-th abnormal one, plus
/// smoothness and sparsity of the abnormal ones (Sultani et al., arXiv 1801.04264, equations 6 and 7).
///
/// scores `[2 b, T]` gives a scalar. Differentiable.
pub fn deepmil_loss<T: Real>(scores: Var<'_, T>) -> Var<'_, T> {
    let highest = top_k_mean(scores, 1);
    let half = highest.shape()[0] / 2;
    let ranking = (highest.slice(0, 0, half) - highest.slice(0, half, half) + 1.0).relu().mean();
    ranking + (smoothness(abnormal(scores)) + sparsity(abnormal(scores))) * CURVE_WEIGHT
}

/// Snippets of a video in RTFM's losses.
pub const RTFM_SNIPPETS: usize = 3;

/// RTFM's magnitude loss: mean of `(|100 - |mean f_a|| + |mean f_n|)^2` over pairs of videos, each mean over its three
/// snippets with the longest features (Tian et al., arXiv 2101.10030, code).
///
/// features `[2 b, T, D]` gives a scalar. Differentiable.
pub fn magnitude_loss<T: Real>(features: Var<'_, T>) -> Var<'_, T> {
    let lengths = length(mean_at_top_k(features, length(features), RTFM_SNIPPETS));
    let half = lengths.shape()[0] / 2;
    let (normal, abnormal) = (lengths.slice(0, 0, half), lengths.slice(0, half, half));
    ((-abnormal + 100.0).abs() + normal).square().mean()
}

/// RTFM's loss of scores: binary cross entropy of the mean score of the three snippets with the longest features.
///
/// scores `[2 b, T]` and features `[2 b, T, D]` give a scalar. Differentiable in the scores.
pub fn magnitude_bag_loss<'t, T: Real>(scores: Var<'t, T>, features: Var<'t, T>) -> Var<'t, T> {
    let (batch, time) = (scores.shape()[0], scores.shape()[1]);
    let videos = mean_at_top_k(scores.reshape([batch, time, 1]), length(features), RTFM_SNIPPETS).reshape([batch]);
    binary_cross_entropy(videos, bag_labels(videos))
}
