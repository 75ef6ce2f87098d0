//! Essential matrices that many matches agree with, from five at a time.

use super::{Rays, sampson, support};
use crate::minimal::five_points;
use weaver_geometry::Pose;
use weaver_geometry::glam::DMat3;
use weaver_kernels::random::Stream;

/// Most and fewest samples of five matches.
const MOST: usize = 500;
const LEAST: usize = 40;
/// Probability of having drawn five right matches by the end.
const SURE: f64 = 0.999;
/// Matches that the first samples are drawn from: the clearest ones.
const CLEAREST: usize = 15;
/// Samples after which all matches may be drawn.
const WIDENED: usize = 200;
/// Hypotheses that are kept, the best.
const KEPT: usize = 10;

/// The poses of the essential matrices with the largest support, one of the four of each; the best first.
///
/// Sources: Fischler and Bolles, "Random sample consensus" (1981); Chum and Matas, "Matching with PROSAC" (2005), for
/// the order of samples. Numbers are drawn by a counter, so that the same matches give the same poses.
pub(super) fn hypotheses(rays: &[Rays], tau: f64) -> Vec<(Pose, f64)> {
    let n = rays.len();
    let stream = Stream::new(n as u64, 0, "sfm.five_points");
    let mut kept: Vec<(DMat3, f64)> = Vec::new();
    let mut needed = MOST;
    let mut sample = 0;
    while sample < needed {
        let pool = (CLEAREST + sample * n / WIDENED).clamp(5.min(n), n);
        if let Some(chosen) = five_of(pool, stream, sample) {
            for matrix in five_points(&chosen.map(|i| rays[i])) {
                let score: f64 = rays.iter().map(|x| support(sampson(&matrix, x).0 / tau)).sum();
                let best = kept.first().map_or(0.0, |best| best.1);
                if kept.len() < KEPT || score > kept[KEPT - 1].1 {
                    let place = kept.partition_point(|k| k.1 >= score);
                    kept.insert(place, (matrix, score));
                    kept.truncate(KEPT);
                }
                if score > best {
                    let agree = rays.iter().filter(|x| support(sampson(&matrix, x).0 / tau) > 0.0).count();
                    let share = agree as f64 / n as f64;
                    let missed = (1.0 - share.powi(5)).clamp(1e-9, 1.0 - 1e-9);
                    needed = (((1.0 - SURE).ln() / missed.ln()).ceil() as usize).clamp(LEAST, MOST);
                }
            }
        }
        sample += 1;
    }
    kept.into_iter().filter_map(|(matrix, score)| Some((decomposed(&matrix)?, score))).collect()
}

/// Five different numbers below `n`.
fn five_of(n: usize, stream: Stream, sample: usize) -> Option<[usize; 5]> {
    let mut chosen = [usize::MAX; 5];
    let mut draw = (sample * 16) as u64;
    let end = draw + 16;
    for k in 0..5 {
        loop {
            if draw == end {
                return None;
            }
            let i = stream.below(draw, n);
            draw += 1;
            if !chosen[..k].contains(&i) {
                chosen[k] = i;
                break;
            }
        }
    }
    Some(chosen)
}

/// One of the four poses of an essential matrix.
///
/// Source: Horn, "Recovering baseline and orientation from essential matrix" (1990): with E = \[t\]x R and |t| = 1, the
/// matrix of cofactors of E is t t^T R, and \[t\]x E = t t^T R - R.
fn decomposed(matrix: &DMat3) -> Option<Pose> {
    let half_trace = 0.5 * matrix.to_cols_array().iter().map(|x| x * x).sum::<f64>();
    let e = *matrix * (1.0 / half_trace.sqrt());
    let cofactors = DMat3::from_cols(e.y_axis.cross(e.z_axis), e.z_axis.cross(e.x_axis), e.x_axis.cross(e.y_axis));
    // Each column of the matrix of cofactors is along t.
    let columns = [cofactors.x_axis, cofactors.y_axis, cofactors.z_axis];
    let t = columns.into_iter().max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))?.try_normalize()?;
    let rotation = cofactors - weaver_geometry::so3::hat(t) * e;
    // Exact for an exact matrix; noise of the solver is taken off.
    let x = rotation.x_axis.try_normalize()?;
    let z = x.cross(rotation.y_axis).try_normalize()?;
    let pose = Pose::new(DMat3::from_cols(x, z.cross(x), z), t);
    pose.rotation.is_finite().then_some(pose)
}

#[cfg(test)]
mod tests {
    use super::super::essential;
    use super::*;
    use weaver_geometry::glam::DVec3;
    use weaver_geometry::so3;

    #[test]
    fn a_matrix_is_that_of_its_pose() {
        let pose = Pose::new(so3::exp(DVec3::new(0.3, -0.5, 0.2)), DVec3::new(2.0, -1.0, 2.0) / 3.0);
        for factor in [1.0, -3.0, 1e-4] {
            let matrix = essential(&pose) * factor;
            let again = essential(&decomposed(&matrix).unwrap());
            let off = |sign: f64| (again * sign - essential(&pose)).to_cols_array().map(f64::abs).iter().sum::<f64>();
            assert!(off(1.0).min(off(-1.0)) < 1e-9, "{factor}");
        }
        assert_eq!(decomposed(&DMat3::ZERO), None);
    }
}
