//! Losses on the pose codes of an iterative camera head.

use weaver_autograd::ops::huber;
use weaver_autograd::{List, Real, Shape, Var, apply_pointwise, pointwise};

/// Weight of an iteration relative to the next one.
const DECAY: f64 = 0.6;

pointwise!(
    /// |a - b|.
    AbsoluteError, 2, |a, b| (a - b).abs()
);

/// The weights of `n` iterations: 0.6^(n-1-i) / n, so that the last counts most.
pub fn iteration_weights(n: usize) -> impl Iterator<Item = f64> {
    (0..n).map(move |i| DECAY.powi((n - 1 - i) as i32) / n as f64)
}

/// The weighted sum of one term per iteration.
fn over_iterations<'t, T: Real>(terms: impl ExactSizeIterator<Item = Var<'t, T>>) -> Var<'t, T> {
    let weights = iteration_weights(terms.len());
    let weighted = weights.zip(terms).map(|(weight, term)| term * weight);
    weighted.reduce(|sum, term| sum + term).expect("a camera head has at least one iteration")
}

/// Panics unless both have the same number of iterations.
#[track_caller]
fn ensure_as_many<T: Real>(a: &[Var<'_, T>], b: &[Var<'_, T>], of: &'static str) {
    if let Some(any) = a.first().or(b.first()) {
        let found: List<Shape> = a.iter().chain(b).map(Var::shape).collect();
        any.tape().ensure_shapes(a.len() == b.len(), of, "as many tensors of the one kind as of the other", &found);
    }
}

/// The Huber distance between two sets of pose codes, over the iterations of a camera head, a scalar.
///
/// It is (1/n) sum_i 0.6^(n-1-i) mean Huber(student_i - teacher_i; delta). Each code is `[.., 9]`: translation,
/// quaternion and field of view weigh the same. Differentiable in both; the signs of quaternions are not aligned.
/// Panics without iterations, or when the numbers of iterations differ. Source: distillation loss of the official
/// SplatWeaver code, with delta = 1 and weight 10.
#[track_caller]
pub fn huber_pose<'t, T: Real>(student: &[Var<'t, T>], teacher: &[Var<'t, T>], delta: f64) -> Var<'t, T> {
    ensure_as_many(student, teacher, "huber_pose");
    over_iterations(student.iter().zip(teacher).map(|(s, t)| huber(*s, *t, delta).mean()))
}

/// The L1 distance of pose codes to one target, over the iterations of a camera head, a scalar.
///
/// It is (1/n) sum_i 0.6^(n-1-i) mean |code_i - target|. Codes and target are `[.., 9]` (translation, quaternion with w
/// >= 0, field of view in radians). Differentiable in both. Panics without iterations.
#[track_caller]
pub fn l1_pose<'t, T: Real>(codes: &[Var<'t, T>], target: Var<'t, T>) -> Var<'t, T> {
    over_iterations(codes.iter().map(|code| l1(*code, target)))
}

/// The L1 distance of rotations and translations to poses in the scene's own frame, over the iterations of a camera
/// head, a scalar.
///
/// It is (1/n) sum_i 0.6^(n-1-i) (mean |R_i - R| + mean |T_i - T|). Rotations are `[.., 3, 3]`, translations `[.., 3]`
/// in the units of the tuple. This loss fixes the frame that the network chooses for each scene, so it helps only where
/// the same scenes are seen many times. Differentiable in all. Panics without iterations, or when there are not as many
/// rotations as translations.
#[track_caller]
pub fn absolute_pose<'t, T: Real>(
    rotations: &[Var<'t, T>],
    translations: &[Var<'t, T>],
    target_rotation: Var<'t, T>,
    target_translation: Var<'t, T>,
) -> Var<'t, T> {
    ensure_as_many(rotations, translations, "absolute_pose");
    let poses = rotations.iter().zip(translations);
    over_iterations(poses.map(|(r, t)| l1(*r, target_rotation) + l1(*t, target_translation)))
}

fn l1<'t, T: Real>(a: Var<'t, T>, b: Var<'t, T>) -> Var<'t, T> {
    apply_pointwise(AbsoluteError, [a, b]).mean()
}
