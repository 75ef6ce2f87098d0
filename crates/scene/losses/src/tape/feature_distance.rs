//! Distance of two feature maps whose vectors are normalized: one layer's term of LPIPS.

use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::parallel;

/// Added to the norm before dividing by it.
const EPSILON: f64 = 1e-10;

#[derive(Debug)]
struct FeatureDistance;

/// sum += the squared length of each pixel's vector; features `[C, P]`.
fn add_squares<T: Real>(features: &[T], sum: &mut [T]) {
    for channel in features.chunks_exact(sum.len()) {
        sum.iter_mut().zip(channel).for_each(|(s, f)| *s += *f * *f);
    }
}

/// The length of each pixel's vector.
fn norms<T: Real>(features: &[T], norm: &mut [T]) {
    norm.fill(T::ZERO);
    add_squares(features, norm);
    norm.iter_mut().for_each(|n| *n = n.sqrt());
}

impl<T: Real> Op<T> for FeatureDistance {
    fn name(&self) -> &'static str {
        "feature_distance"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(
            ins.len() == 3 && ins[0].rank() == 4 && ins[0] == ins[1] && ins[2].len() == ins[0][1],
            "features [N, C, H, W] twice, weights [C]"
        );
        Ok(Shapes::one([ins[0][0]]))
    }
    fn differentiable(&self, index: usize) -> bool {
        index < 2
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], pool: &Pool) {
        let shape = ins[0].shape();
        let (pixels, image) = (shape[2] * shape[3], shape[1] * shape[2] * shape[3]);
        let mut scratch = pool.buffer::<T>(shape[0] * 2 * pixels);
        let epsilon = T::from_f64(EPSILON);
        parallel::for_chunks(&mut scratch, 2 * pixels, |n, scratch| {
            let (a, b) = (&ins[0][n * image..][..image], &ins[1][n * image..][..image]);
            let (norm_a, norm_b) = scratch.split_at_mut(pixels);
            norms(a, norm_a);
            norms(b, norm_b);
            let mut total = 0.0;
            for ((a, b), weight) in a.chunks_exact(pixels).zip(b.chunks_exact(pixels)).zip(ins[2].iter()) {
                let mut sum = T::ZERO;
                for i in 0..pixels {
                    let difference = a[i] / (norm_a[i] + epsilon) - b[i] / (norm_b[i] + epsilon);
                    sum += difference * difference;
                }
                total += (*weight * sum).to_f64();
            }
            scratch[0] = T::from_f64(total / pixels as f64);
        });
        outs[0].iter_mut().zip(scratch.chunks(2 * pixels)).for_each(|(out, s)| *out = s[0]);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, pool, .. } = at;
        let shape = ins[0].shape();
        let (pixels, image) = (shape[2] * shape[3], shape[1] * shape[2] * shape[3]);
        let epsilon = T::from_f64(EPSILON);
        let weights = &ins[2];
        for (of, dx) in dins.iter_mut().take(2).enumerate() {
            let Some(dx) = dx else { continue };
            // Per image: both norms, and the part of the gradient along the vector itself.
            let mut scratch = pool.buffer::<T>(shape[0] * 3 * pixels);
            parallel::for_chunks(&mut scratch, 3 * pixels, |n, scratch| {
                let (a, b) = (&ins[of][n * image..][..image], &ins[1 - of][n * image..][..image]);
                let (norm_a, rest) = scratch.split_at_mut(pixels);
                let (norm_b, along) = rest.split_at_mut(pixels);
                norms(a, norm_a);
                norms(b, norm_b);
                along.fill(T::ZERO);
                for ((a, b), weight) in a.chunks_exact(pixels).zip(b.chunks_exact(pixels)).zip(weights.iter()) {
                    for i in 0..pixels {
                        let unit = a[i] / (norm_a[i] + epsilon);
                        along[i] += *weight * (unit - b[i] / (norm_b[i] + epsilon)) * unit;
                    }
                }
            });
            let (dx, beta) = dx.target();
            parallel::for_chunks(dx, pixels, |plane, dx| {
                let (n, c) = (plane / shape[1], plane % shape[1]);
                let (a, b) = (&ins[of][plane * pixels..][..pixels], &ins[1 - of][plane * pixels..][..pixels]);
                let (norm_a, rest) = scratch[n * 3 * pixels..][..3 * pixels].split_at(pixels);
                let (norm_b, along) = rest.split_at(pixels);
                let factor = T::from_f64(2.0) * douts[0][n] / T::from_usize(pixels);
                for i in 0..pixels {
                    let before = if beta == T::ZERO { T::ZERO } else { dx[i] };
                    // d|a| / da has no value at 0; the term that it multiplies vanishes there.
                    let slope = if norm_a[i] > T::ZERO {
                        let direct = weights[c] * (a[i] / (norm_a[i] + epsilon) - b[i] / (norm_b[i] + epsilon));
                        factor * (direct - along[i] * a[i] / norm_a[i]) / (norm_a[i] + epsilon)
                    } else {
                        T::ZERO
                    };
                    dx[i] = before + slope;
                }
            });
        }
    }
}

/// The weighted squared distance of normalized feature vectors, averaged over the pixels of each image.
///
/// It is mean_p sum_c w_c (a_pc / (|a_p| + 1e-10) - b_pc / (|b_p| + 1e-10))^2. Features a and b
/// `[N, C, H, W]` and weights w `[C]` give `[N]`. Differentiable in both features, with gradient 0 at pixels whose own
/// features are all 0; the weights are constants.
#[track_caller]
pub(crate) fn feature_distance<'t, T: Real>(a: Var<'t, T>, b: Var<'t, T>, weights: Var<'t, T>) -> Var<'t, T> {
    let [distance] = a.tape().apply(FeatureDistance, &[a, b, weights]);
    distance
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use weaver_autograd::Tape;
    use weaver_autograd::gradcheck::{Input, gradcheck};

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 20))]

        #[test]
        fn gradient(n in 1..3usize, c in 1..5usize, h in 1..4usize, w in 1..4usize, seed in any::<u64>()) {
            let features = |seed| Input::uniform(seed, 0.1, 1.0, [n, c, h, w]);
            let weights = Input::uniform(seed, 0.0, 1.0, [c]).constant();
            gradcheck(&[features(seed), features(!seed), weights], |x| vec![feature_distance(x[0], x[1], x[2])]);
        }
    }

    #[test]
    fn pixels_without_features_have_no_gradient() {
        let tape = Tape::<f64>::new();
        let a = tape.leaf(&[0.0, 3.0, 0.0, 4.0], [1, 2, 1, 2]);
        let b = tape.leaf(&[1.0, 0.0, 0.0, 0.0], [1, 2, 1, 2]);
        let distance = feature_distance(a, b, tape.constant(&[1.0, 1.0], [2]));
        // (1 + 0) for the first pixel, 0.36 + 0.64 for the second.
        assert!((distance.item() - 1.0).abs() < 1e-9);
        distance.backward();
        let (da, db) = (a.grad().unwrap(), b.grad().unwrap());
        assert_eq!([da[0], da[2], db[1], db[3]], [0.0; 4]);
        assert!(da.iter().chain(&db).all(|g| g.is_finite()));
    }
}
