//! The similarity transform that lays most cameras over their positions.

use weaver_geometry::Similarity;
use weaver_geometry::glam::{DMat3, DQuat, DVec2, DVec3};
use weaver_kernels::order::median_mean;
use weaver_kernels::random::Stream;

/// Smallest sets of cameras that are tried.
const DRAWS: u64 = 400;
/// Rounds of the fit to the positions that agree.
const ROUNDS: usize = 10;
/// Median of the lengths of normally distributed vectors, over the deviation along an axis, in two and in three
/// dimensions.
const MEDIAN: [f64; 2] = [1.1774, 1.5382];
/// Deviations up to which a position agrees.
const AGREES: f64 = 3.5;
/// Spread across a line, over the spread along it, below which a turn about the line is not determined.
const LINE: f64 = 1e-3;

/// A transform, and the positions that agree with it.
#[derive(Clone, Debug)]
pub(super) struct Robust {
    pub similarity: Similarity,
    /// Distance of each camera from its position along the ground.
    pub off: Vec<f64>,
    /// Height of each camera above its position.
    pub above: Vec<f64>,
    pub agrees: Vec<bool>,
    /// Deviation of a position, from all that agree.
    pub deviation: f64,
}

impl Robust {
    /// Number of positions that agree.
    pub fn used(&self) -> usize {
        self.agrees.iter().filter(|agrees| **agrees).count()
    }

    /// Root of the mean square distance along the ground of the positions that agree from their middle, and the
    /// smallest of these roots along a horizontal axis.
    pub fn spread(&self, to: &[DVec3]) -> [f64; 2] {
        let used: Vec<DVec3> = to.iter().zip(&self.agrees).filter(|(_, agrees)| **agrees).map(|(p, _)| *p).collect();
        let n = used.len().max(1) as f64;
        let middle = used.iter().sum::<DVec3>() / n;
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for p in used {
            let d = p - middle;
            (xx, xy, yy) = (xx + d.x * d.x, xy + d.x * d.y, yy + d.y * d.y);
        }
        let least = 0.5 * (xx + yy) - (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
        [((xx + yy) / n).sqrt(), (least.max(0.0) / n).sqrt()]
    }
}

/// Fits any similarity transform: three positions or more, not on a line.
pub(super) fn free(from: &[DVec3], to: &[DVec3]) -> Option<Robust> {
    robust(from, to, 3, |from, to| {
        let found = Similarity::fit(from, to)?;
        is_wide(to).then_some(found)
    })
}

/// Fits a transform that takes a direction to z: two positions or more, not above one another. Heights of positions
/// shift it, by their median, and tell nothing else: those of satellites drift.
pub(super) fn vertical(from: &[DVec3], to: &[DVec3], up: DVec3) -> Option<Robust> {
    let level = DMat3::from_quat(DQuat::from_rotation_arc(up, DVec3::Z));
    let mut found = robust(from, to, 2, |from, to| {
        let n = from.len() as f64;
        let (from_mean, to_mean) = (from.iter().sum::<DVec3>() / n, to.iter().sum::<DVec3>() / n);
        // Turn and scale in the plane are a complex number.
        let (mut turn, mut spread) = (DVec2::ZERO, 0.0);
        for (f, t) in from.iter().zip(to) {
            let (f, t) = ((level * (*f - from_mean)).truncate(), (*t - to_mean).truncate());
            turn += DVec2::new(f.dot(t), f.perp_dot(t));
            spread += f.length_squared();
        }
        let scale = turn.length() / spread;
        let rotation = DMat3::from_rotation_z(turn.y.atan2(turn.x)) * level;
        let determined = scale.is_finite() && scale > 0.0;
        determined.then(|| Similarity { scale, rotation, translation: to_mean - rotation * from_mean * scale })
    })?;
    let height = median_mean(&mut found.above.clone())?;
    found.similarity.translation.z -= height;
    found.above.iter_mut().for_each(|above| *above -= height);
    Some(found)
}

/// True for points that are not on a line.
fn is_wide(points: &[DVec3]) -> bool {
    let Some(first) = points.first() else { return false };
    let Some(far) = points.iter().max_by(|a, b| a.distance(*first).total_cmp(&b.distance(*first))) else {
        return false;
    };
    let along = (*far - *first).normalize_or_zero();
    let across = |p: &DVec3| (*p - *first).cross(along).length();
    points.iter().map(across).fold(0.0, f64::max) > LINE * far.distance(*first)
}

/// The least median of distances over small sets, then the mean square over all that agree.
///
/// Source: Rousseeuw, Least Median of Squares Regression, 1984.
fn robust(
    from: &[DVec3],
    to: &[DVec3],
    least: usize,
    fit: impl Fn(&[DVec3], &[DVec3]) -> Option<Similarity>,
) -> Option<Robust> {
    let n = from.len();
    if n < least {
        return None;
    }
    let chosen = |which: &[usize]| {
        let pick = |points: &[DVec3]| which.iter().map(|i| points[*i]).collect::<Vec<_>>();
        fit(&pick(from), &pick(to))
    };
    // With the vertical given, heights do not count.
    let dimensions = least;
    let away = |s: &Similarity| from.iter().zip(to).map(|(f, t)| s.apply(*f) - *t).collect::<Vec<DVec3>>();
    let length = |d: &DVec3| if dimensions == 2 { d.truncate().length() } else { d.length() };
    let off = |s: &Similarity| away(s).iter().map(length).collect::<Vec<f64>>();
    let rng = Stream::new(0, 0, "placing");
    let drawn = (0..DRAWS).filter_map(|draw| chosen(&rng.fork(draw).permutation(n)[..least]));
    let all: Vec<usize> = (0..n).collect();
    let judged = drawn.chain(chosen(&all)).map(|s| (median_mean(&mut off(&s)).unwrap_or(f64::INFINITY), s));
    let (median, mut similarity) = judged.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let mut deviation = median / MEDIAN[dimensions - 2] * (1.0 + 5.0 / n as f64);
    let mut agrees = vec![true; n];
    for _ in 0..ROUNDS {
        let now = off(&similarity);
        agrees = now.iter().map(|off| *off <= AGREES * deviation.max(1e-9)).collect();
        let used: Vec<usize> = (0..n).filter(|i| agrees[*i]).collect();
        let Some(next) = chosen(&used) else { break };
        similarity = next;
        let now = off(&similarity);
        let squares: f64 = used.iter().map(|i| now[*i] * now[*i]).sum();
        // Seven numbers are fitted to three for each position, or four to two.
        let freedom = (dimensions * used.len()).saturating_sub(3 * dimensions - 2).max(1);
        deviation = (squares / freedom as f64).sqrt();
    }
    let away = away(&similarity);
    let off = away.iter().map(|d| d.truncate().length()).collect();
    let above = away.iter().map(|d| d.z).collect();
    Some(Robust { off, above, similarity, agrees, deviation })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cameras() -> Vec<DVec3> {
        (0..20).map(|i| DVec3::new(f64::from(i % 5), f64::from(i / 5), 0.1 * f64::from(i % 3))).collect()
    }

    /// Noise of a twentieth, and a fourth of the positions anywhere.
    #[test]
    fn wrong_positions_do_not_count() {
        let truth = Similarity {
            scale: 30.0,
            rotation: DMat3::from_rotation_z(1.0) * DMat3::from_rotation_x(0.4),
            translation: DVec3::new(5.0, -7.0, 100.0),
        };
        let rng = Stream::new(3, 0, "noise");
        let noise =
            |i: usize| DVec3::new(rng.normal(3 * i as u64), rng.normal(3 * i as u64 + 1), rng.normal(3 * i as u64 + 2));
        let from = cameras();
        let to: Vec<DVec3> = (from.iter().enumerate())
            .map(|(i, p)| truth.apply(*p) + noise(i) * if i % 4 == 1 { 200.0 } else { 0.5 })
            .collect();
        let found = free(&from, &to).unwrap();
        assert!((found.similarity.scale / 30.0 - 1.0).abs() < 0.02, "{:?}", found.similarity);
        assert!((14..=15).contains(&found.used()) && found.agrees.iter().skip(1).step_by(4).all(|a| !a));
        assert!((0.25..1.0).contains(&found.deviation), "{}", found.deviation);
        let up = truth.rotation.transpose() * DVec3::Z;
        let found = vertical(&from, &to, up).unwrap();
        assert!((found.similarity.scale / 30.0 - 1.0).abs() < 0.02);
        assert!((found.similarity.rotation * up).distance(DVec3::Z) < 1e-12);
        // Heights that drift by a hundred meters tilt nothing.
        let drifted: Vec<DVec3> = to.iter().zip(0..).map(|(p, i)| *p + DVec3::Z * 5.0 * f64::from(i)).collect();
        let found = vertical(&from, &drifted, up).unwrap();
        assert!((found.similarity.scale / 30.0 - 1.0).abs() < 0.02 && found.used() >= 14);
    }

    #[test]
    fn a_line_of_cameras_leaves_the_turn_about_it_open() {
        let from: Vec<DVec3> = (0..9).map(|i| DVec3::X * f64::from(i)).collect();
        let to: Vec<DVec3> = from.iter().map(|p| DVec3::new(0.0, 2.0 * p.x, 7.0)).collect();
        assert!(free(&from, &to).is_none());
        let found = vertical(&from, &to, DVec3::NEG_Y).unwrap();
        assert!((found.similarity.scale - 2.0).abs() < 1e-9 && found.off.iter().all(|off| *off < 1e-9));
    }
}
