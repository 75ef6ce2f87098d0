//! Lenses of other programs in the terms of OpenCV.

use std::f64::consts::FRAC_PI_2;
use weaver_geometry::{Distortion, Intrinsics};
use weaver_kernels::dense::{cholesky, cholesky_solve};

/// Places from the axis outward at which a lens is compared.
const SAMPLES: usize = 400;
/// Times that the fit weighs its places by the denominator that it found.
const ROUNDS: usize = 3;
/// Ridge of the fit, over the mean square of its terms: some numerators and denominators are nearly the same lens.
const RIDGE: f64 = 1e-13;
/// Part of the way to the farthest corner up to which a lens has to make sense.
const LEAST_REACH: f64 = 0.9;
/// Largest error of a lens that is fitted, pixels.
const EXACT: f64 = 0.1;

/// The distortion of Brown's lens `1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8` with p1 and p2 in OpenCV's order.
///
/// OpenCV has no term of r^8. Where there is one, its rational lens is fitted to this one over the photo.
///
/// # Errors
/// The largest error of that, pixels, where it is more than a tenth.
pub(super) fn brown(
    k: [f64; 4],
    p: [f64; 2],
    intrinsics: &Intrinsics,
    (width, height): (usize, usize),
) -> Result<Option<Distortion>, f64> {
    let [k1, k2, k3, k4] = k;
    let exact = Distortion::Radial { k: [k1, k2, k3, 0.0, 0.0, 0.0], p };
    if k4 == 0.0 || !k4.is_finite() {
        return Ok(exact.or_none());
    }
    let Intrinsics { fx, fy, cx, cy } = *intrinsics;
    let x = cx.abs().max((width as f64 - cx).abs()) / fx;
    let y = cy.abs().max((height as f64 - cy).abs()) / fy;
    let (corner, focal) = (x.hypot(y), fx.max(fy));
    let scale = |t: f64| 1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4)));
    // Distances from the axis up to the one that is seen in the corner, or to where the lens folds back.
    let mut reach = 0.0;
    while reach < 10.0 * corner && reach * scale(reach * reach) < corner {
        let next = reach + corner / SAMPLES as f64;
        if next * scale(next * next) <= reach * scale(reach * reach) {
            break;
        }
        reach = next;
    }
    let seen = reach * scale(reach * reach);
    let enough = LEAST_REACH * corner;
    if (seen - enough).is_nan() || seen < enough {
        return Err((corner - seen) * focal);
    }
    let fitted = rational(scale, reach);
    let off = |i: usize| {
        let r = reach * i as f64 / SAMPLES as f64;
        (r * (fitted_scale(&fitted, r * r) - scale(r * r))).abs() * focal
    };
    let worst = (0..=SAMPLES).map(off).fold(0.0, f64::max);
    // Also for what is not a number.
    if worst <= EXACT { Ok(Some(Distortion::Radial { k: fitted, p })) } else { Err(worst) }
}

fn fitted_scale(k: &[f64; 6], t: f64) -> f64 {
    let [a, b, c, d, e, f] = k;
    (1.0 + t * (a + t * (b + t * c))) / (1.0 + t * (d + t * (e + t * f)))
}

/// k1 to k6 of the rational lens that is nearest to a factor on points up to a distance from the axis: least squares on
/// `numerator - factor denominator`, over the denominator of the round before.
fn rational(factor: impl Fn(f64) -> f64, reach: f64) -> [f64; 6] {
    // In units of the largest square, so that all powers are of one size.
    let largest = reach * reach;
    let mut found = [0.0; 6];
    for _ in 0..ROUNDS {
        let (mut matrix, mut x) = ([0.0; 36], [0.0; 6]);
        for i in 1..=SAMPLES {
            // Denser toward the edge, where the error would be largest: nearly the least largest error.
            let r = (FRAC_PI_2 * i as f64 / SAMPLES as f64).sin();
            let t = r * r;
            let s = factor(t * largest);
            let denominator = 1.0 + t * (found[3] + t * (found[4] + t * found[5]));
            let weight = r / denominator;
            let row = [t, t * t, t * t * t, -s * t, -s * t * t, -s * t * t * t].map(|term| term * weight);
            for (a, left) in row.iter().enumerate() {
                row.iter().enumerate().for_each(|(b, right)| matrix[6 * a + b] += left * right);
                x[a] += left * weight * (s - 1.0);
            }
        }
        (0..6).for_each(|i| matrix[7 * i] += RIDGE * SAMPLES as f64);
        if !cholesky(&mut matrix, 6, 6) {
            return [f64::NAN; 6];
        }
        cholesky_solve(&matrix, &mut x);
        found = x;
    }
    std::array::from_fn(|i| found[i] / largest.powi(i as i32 % 3 + 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::glam::DVec2;

    /// The lens of a DJI M3M as Metashape exports it, which bends the corner by a hundred pixels with r^8 alone.
    #[test]
    fn a_term_of_the_eighth_power_is_kept() {
        let intrinsics = Intrinsics { fx: 3706.0, fy: 3705.5, cx: 2651.7, cy: 1950.3 };
        let k = [-0.0919367147, -0.0762807468, 0.1162639394, -0.0761413904];
        let lens = brown(k, [0.0; 2], &intrinsics, (5280, 3956)).unwrap().unwrap();
        let mut worst = 0.0_f64;
        for (u, v) in [(0.0, 0.0), (5280.0, 0.0), (2000.0, 1500.0), (0.0, 3956.0), (5280.0, 3956.0)] {
            let seen = DVec2::new((u - 2651.7) / 3706.0, (v - 1950.3) / 3705.5);
            let point = lens.undistort(seen).unwrap();
            let t = point.length_squared();
            let scale = 1.0 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3])));
            worst = worst.max((point * scale).distance(seen) * 3706.0);
        }
        assert!(worst < EXACT, "{worst} pixels");
        assert!((k[3] * 0.6_f64.powi(4)).abs() * 3706.0 > 10.0, "the term matters");
    }

    #[test]
    fn a_lens_without_that_term_is_exact() {
        let intrinsics = Intrinsics { fx: 100.0, fy: 100.0, cx: 50.0, cy: 50.0 };
        let lens = brown([0.1, -0.2, 0.3, 0.0], [1e-3, 2e-3], &intrinsics, (100, 100)).unwrap();
        assert_eq!(lens, Some(Distortion::Radial { k: [0.1, -0.2, 0.3, 0.0, 0.0, 0.0], p: [1e-3, 2e-3] }));
        assert_eq!(brown([0.0; 4], [0.0; 2], &intrinsics, (100, 100)), Ok(None));
    }
}
