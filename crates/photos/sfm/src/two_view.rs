//! Relative pose by robust descent on Sampson's distance, from candidate poses of samples of five matches: the same
//! matches give the same pose, bit for bit.

mod normal;
mod search;

use normal::Normal;
use std::f64::consts::PI;
use weaver_geometry::glam::{DMat3, DVec2, DVec3};
use weaver_geometry::{Pose, Similarity, so3};
use weaver_kernels::parallel;

/// The fewest matches a pose is estimated from: its five unknowns, and some to reject wrong matches by.
const FEWEST: usize = 8;
/// Gauss-Newton steps from each start, and of the descent to the best rotation.
const STEPS: usize = 6;
const TURNING: usize = 14;
/// Scales that a descent begins with: samples of five lead nearly there.
const BRIDGED: f64 = 3.0;
/// Number of the best descents that are carried to their optimum.
const FINALISTS: usize = 3;
/// Rotations farther apart than this, radians, and translations three times as far, are different explanations; they
/// are rivals from this part of the best score.
const DIFFERENT: f64 = 0.1;
const RIVAL: f64 = 0.7;
/// Residuals are inliers up to this many times their scale.
const CUTOFF: f64 = 2.0;

/// Relative pose of two views, with its inliers.
#[derive(Clone, Debug, PartialEq)]
pub struct TwoView {
    /// From camera i to camera j: x_j = R x_i + t with |t| = 1.
    pub pose: Pose,
    /// True if Sampson's distance of each match is below 2 tau.
    pub inliers: Vec<bool>,
    /// The inverse depth of each match in view i, in units of 1 / |t|: positive if and only if in front of both views.
    pub depths: Vec<f64>,
    /// The support sum max(0, 1 - (r / 2 tau)^2) over matches with Sampson's distances r, times [`front`](Self::front).
    pub score: f64,
    /// The share of inliers that are in front of both views.
    pub front: f64,
    /// The median angle between the rays of inliers once the rotation is undone, in radians.
    pub parallax: f64,
    /// Another pose that explains nearly as much, as two do for a plane.
    pub rival: Option<Pose>,
}

/// The homogeneous normalized coordinates (x, y, 1) of a match in views i and j.
pub(crate) type Rays = [DVec3; 2];

/// Estimates the relative pose of two views by minimizing Sampson's distance
/// r = x_j . E x_i / sqrt((E x_i)_1^2 + (E x_i)_2^2 + (E^T x_j)_1^2 + (E^T x_j)_2^2), E = \[t\]x R, robustly.
///
/// Both `matches`, normalized coordinates (u - c) / f, and `tau`, the scale of r for inliers, are in focal lengths.
/// `None` with fewer than 8 matches that are finite, or when no pose has an inlier.
///
/// Sources: Sampson, "Fitting conic sections to 'very scattered' data" (1982); Hartley & Zisserman, "Multiple View
/// Geometry in Computer Vision" (2004), sections 9.6 and 11.4.
///
/// ```
/// use weaver_geometry::glam::{DVec2, DVec3};
/// use weaver_geometry::{Pose, so3};
/// use weaver_sfm::two_view;
///
/// let truth = Pose::new(so3::exp(DVec3::new(0.1, -0.3, 0.05)), DVec3::new(0.8, 0.0, 0.6));
/// let matches: Vec<[DVec2; 2]> = (0..40)
///     .map(|k| {
///         let point = DVec3::new(f64::from(k % 7) - 3.0, f64::from(k % 5) - 2.0, 5.0 + f64::from(k % 3));
///         [point, truth.apply(point)].map(|x| x.truncate() / x.z)
///     })
///     .collect();
/// let found = two_view(&matches, 1.0 / 400.0).ok_or("no pose")?;
/// assert!(found.pose.angle_to(&truth) < 1e-6);
/// assert!(found.pose.translation.angle_between(truth.translation) < 1e-6);
/// # Ok::<(), &str>(())
/// ```
pub fn two_view(matches: &[[DVec2; 2]], tau: f64) -> Option<TwoView> {
    let rays: Vec<Rays> = matches.iter().filter_map(homogeneous).collect();
    if rays.len() < FEWEST {
        return None;
    }
    let mut suggested: Vec<Pose> = search::hypotheses(&rays, tau).into_iter().map(|(pose, _)| pose).collect();
    // For a pure rotation, five matches leave the pose undetermined.
    let turn = robust_kabsch(&rays);
    suggested.extend([DVec3::X, DVec3::Y, DVec3::Z].map(|axis| Pose::new(turn, axis)));
    let fits = descents(&suggested, &rays, &annealing::<STEPS>(BRIDGED, tau), tau);
    // Along shallow valleys, the damped steps above end short of the optimum.
    let finalists: Vec<Pose> = fits.iter().map(|fit| fit.0).take(FINALISTS).collect();
    let polished = descents(&finalists, &rays, &[tau; 20], tau);
    let (pose, score) = *polished.first()?;
    let other = fits.iter().map(|fit| fit.0).find(|other| differ(&pose, other));
    let rival = other.map(|other| descents(&[other], &rays, &[tau; 20], tau)[0]);
    let rival = rival.filter(|(rival, s)| *s > RIVAL * score && differ(&pose, rival)).map(|rival| rival.0);
    judge(pose, matches, tau).map(|view| TwoView { rival, ..view })
}

/// A pose refined on rays that differ a little from the ones it was found by, and its support there.
pub(crate) fn followed(pose: &Pose, rays: &[Rays], tau: f64) -> (Pose, f64) {
    facing(&descend(*pose, rays, &[2.0 * tau, tau, tau]), rays, tau)
}

/// True if two relative poses are different explanations.
fn differ(a: &Pose, b: &Pose) -> bool {
    a.angle_to(b) > DIFFERENT || a.translation.angle_between(b.translation) > 3.0 * DIFFERENT
}

/// The best pure rotation between two views, and its inlier count: x_j is within 2 `tau` of R x_i, projected.
///
/// If it has as many inliers as [`two_view`], the direction of translation and all depths are undetermined. Units as in
/// [`two_view`]; the identity and its count where the matches determine no rotation.
///
/// Sources: Kabsch, "A solution for the best rotation to relate two sets of vectors" (1976), made robust; Hartley &
/// Zisserman (2004), section 13.1, for the homography of a rotating camera.
///
/// ```
/// use weaver_geometry::glam::{DVec2, DVec3};
/// use weaver_geometry::so3;
/// use weaver_sfm::rotation_only;
///
/// let turn = so3::exp(DVec3::new(0.0, 0.4, 0.1));
/// let matches: Vec<[DVec2; 2]> = (0..20)
///     .map(|k| {
///         let ray = DVec3::new(f64::from(k % 5) / 5.0 - 0.4, f64::from(k / 5) / 4.0 - 0.4, 1.0);
///         [ray, turn * ray].map(|x| x.truncate() / x.z)
///     })
///     .collect();
/// let (rotation, explained) = rotation_only(&matches, 1.0 / 400.0);
/// assert_eq!(explained, 20);
/// assert!(so3::log(&(rotation * turn.transpose())).length() < 1e-6);
/// ```
pub fn rotation_only(matches: &[[DVec2; 2]], tau: f64) -> (DMat3, usize) {
    let rays: Vec<Rays> = matches.iter().filter_map(homogeneous).collect();
    let mut rotation = robust_kabsch(&rays);
    for scale in annealing::<TURNING>(12.0, tau) {
        let mut normal = Normal::<3>::default();
        for [x, y] in &rays {
            let p = rotation * *x;
            let r = transfer_error(p, *y);
            let weight = robust_weight(r.length() / scale);
            for (r, axis) in [(r.x, DVec3::X), (r.y, DVec3::Y)] {
                // d (p_x / p_z) for dp = w x p.
                let row = p.cross(axis - DVec3::Z * p.dot(axis) / p.z) / p.z;
                normal.add(weight, r, &row.to_array());
            }
        }
        let Some(turn) = normal.step() else { break };
        rotation = so3::exp(DVec3::from_array(turn)) * rotation;
    }
    (rotation, matches.iter().filter(|x| turns(&rotation, x, tau)).count())
}

/// True if a pure rotation explains a match.
pub(crate) fn turns(rotation: &DMat3, x: &[DVec2; 2], tau: f64) -> bool {
    homogeneous(x).is_some_and(|[x, y]| transfer_error(*rotation * x, y).length() < CUTOFF * tau)
}

/// Judges a pose by all matches; `None` when it has no inlier.
pub(crate) fn judge(pose: Pose, matches: &[[DVec2; 2]], tau: f64) -> Option<TwoView> {
    let essential = essential(&pose);
    let mut view =
        TwoView { pose, inliers: Vec::new(), depths: Vec::new(), score: 0.0, front: 0.0, parallax: 0.0, rival: None };
    let mut angles = Vec::new();
    for x in matches.iter().map(homogeneous) {
        // Matches that are not finite keep their places, as outliers without a depth.
        let depth = x.map_or(0.0, |x| inverse_depth(&pose, &x));
        let score = x.map_or(0.0, |x| support(sampson(&essential, &x).0 / tau));
        view.inliers.push(score > 0.0);
        view.depths.push(depth);
        view.score += score;
        if let Some([x, y]) = x.filter(|_| score > 0.0) {
            view.front += f64::from(depth > 0.0);
            angles.push((pose.rotation * x).angle_between(y));
        }
    }
    if angles.is_empty() {
        return None;
    }
    view.front /= angles.len() as f64;
    view.score *= view.front;
    let middle = angles.len() / 2;
    view.parallax = *angles.select_nth_unstable_by(middle, f64::total_cmp).1;
    Some(view)
}

/// A match in homogeneous coordinates; `None` if it is NaN or at the horizon, where squares would overflow.
pub(crate) fn homogeneous(x: &[DVec2; 2]) -> Option<Rays> {
    x.iter().all(|x| x.length_squared() < 1e12).then(|| x.map(|x| x.extend(1.0)))
}

/// The rotation of the unit bearings of view i onto the bearings of view j by iteratively reweighted least squares:
/// bearings 0.15 apart count a half. The identity where bearings do not determine it.
fn robust_kabsch(rays: &[Rays]) -> DMat3 {
    let mut rotation = None;
    for _ in 0..6 {
        let mut pairs = [Vec::new(), Vec::new()];
        for bearings in rays.iter().map(|x| x.map(DVec3::normalize)) {
            let error = rotation.map_or(0.0, |r: DMat3| (r * bearings[0]).distance(bearings[1]));
            let root = 1.0 / (1.0 + (error / 0.15).powi(2)).sqrt();
            for (pairs, bearing) in pairs.iter_mut().zip(bearings) {
                // With its opposite, so that the centroids are the origin and the fit is a rotation alone.
                pairs.extend([bearing * root, -bearing * root]);
            }
        }
        rotation = Similarity::fit(&pairs[0], &pairs[1]).map(|fit| fit.rotation).or(rotation);
    }
    rotation.unwrap_or(DMat3::IDENTITY)
}

/// The scale of residuals in each step of a descent: from so many tau, which bridges local minima, geometrically to
/// tau.
fn annealing<const N: usize>(from: f64, tau: f64) -> [f64; N] {
    std::array::from_fn(|k| tau * from.powf(1.0 - k as f64 / (N - 1) as f64))
}

/// The weight 1 / (1 + e^2)^2 of a residual of e scales (Geman & McClure 1987).
fn robust_weight(e: f64) -> f64 {
    (1.0 + e * e).powi(-2)
}

/// Contribution of a residual of e scales to the score of a pose: 1 at 0, nothing from 2 on.
fn support(e: f64) -> f64 {
    (1.0 - (e / CUTOFF).powi(2)).max(0.0)
}

/// The essential matrix \[t\]x R.
fn essential(pose: &Pose) -> DMat3 {
    so3::hat(pose.translation) * pose.rotation
}

/// Sampson's distance of a match from the epipolar constraint, and its denominator.
fn sampson(essential: &DMat3, [x, y]: &Rays) -> (f64, f64) {
    let line = *essential * *x;
    let back = DVec2::new(essential.x_axis.dot(*y), essential.y_axis.dot(*y));
    // Away from 0, which it would be where both rays pass through the epipoles.
    let norm = (line.truncate().length_squared() + back.length_squared()).sqrt().max(1e-12);
    (y.dot(line) / norm, norm)
}

/// The derivatives of x_j . E x_i with respect to w, a and b, where R becomes exp(w) R and t becomes t + a d1 + b d2.
fn slopes(pose: &Pose, [d1, d2]: [DVec3; 2], [x, y]: &Rays) -> [f64; 5] {
    let p = pose.rotation * *x;
    let w = p.cross(y.cross(pose.translation));
    [w.x, w.y, w.z, y.cross(d1).dot(p), y.cross(d2).dot(p)]
}

/// Results of the descents from each start, and their scores, the best first.
fn descents(starts: &[Pose], rays: &[Rays], scales: &[f64], tau: f64) -> Vec<(Pose, f64)> {
    let mut fits: Vec<(Pose, f64)> = starts.iter().map(|&start| (start, 0.0)).collect();
    parallel::for_chunks(&mut fits, 1, |_, fit| {
        for fit in fit {
            *fit = facing(&descend(fit.0, rays, scales), rays, tau);
        }
    });
    fits.sort_by(|a, b| b.1.total_cmp(&a.1));
    fits
}

/// The pose with most inliers in front of both views among the four of an essential matrix, and its score.
///
/// Done for each descent: a plane has two essential matrices, and the one with a little more support may be behind.
fn facing(pose: &Pose, rays: &[Rays], tau: f64) -> (Pose, f64) {
    let essential = essential(pose);
    let poses = same_essential(pose);
    let (mut total, mut inliers, mut front) = (0.0, 0.0, [0.0; 4]);
    for x in rays {
        let score = support(sampson(&essential, x).0 / tau);
        if score > 0.0 {
            total += score;
            inliers += 1.0;
            for (front, pose) in front.iter_mut().zip(&poses) {
                *front += f64::from(inverse_depth(pose, x) > 0.0);
            }
        }
    }
    // Ties go to the first, so that nothing changes without a reason.
    let best = (1..4).fold(0, |best, k| if front[k] > front[best] { k } else { best });
    (poses[best], total * front[best] / f64::max(inliers, 1.0))
}

/// Gauss-Newton on Sampson's distances, one step with robust weights of each scale.
///
/// The denominators are held in each step: their derivatives are multiplied by residuals, which vanish at the solution.
fn descend(mut pose: Pose, rays: &[Rays], scales: &[f64]) -> Pose {
    for scale in scales {
        let essential = essential(&pose);
        let (d1, d2) = pose.translation.any_orthonormal_pair();
        let mut normal = Normal::<5>::default();
        for x in rays {
            let (r, norm) = sampson(&essential, x);
            let row = slopes(&pose, [d1, d2], x).map(|d| d / norm);
            normal.add(robust_weight(r / scale), r, &row);
        }
        let Some([x, y, z, a, b]) = normal.step() else { break };
        let translation = (pose.translation + d1 * a + d2 * b).normalize();
        pose = Pose::new(so3::exp(DVec3::new(x, y, z)) * pose.rotation, translation);
    }
    pose
}

/// The four poses with the essential matrix of one, up to sign: translation reversed, and rotation followed by half a
/// turn about the translation (Hartley & Zisserman 2004, result 9.19).
fn same_essential(pose: &Pose) -> [Pose; 4] {
    let t = pose.translation;
    let turned = DMat3::from_axis_angle(t, PI) * pose.rotation;
    [(pose.rotation, t), (pose.rotation, -t), (turned, t), (turned, -t)].map(|(r, t)| Pose::new(r, t))
}

/// The residual R x_i projected - x_j for the turned ray p = R x_i; infinite behind view j.
fn transfer_error(p: DVec3, y: DVec3) -> DVec2 {
    if p.z > 0.0 { (p / p.z - y).truncate() } else { DVec2::INFINITY }
}

/// The inverse depth rho in view i at which R x_i + rho t comes closest to x_j; 0 if that is behind view j.
///
/// It minimizes |a + rho b|^2 with a = p_xy - x_j p_z and b = t_xy - x_j t_z, p = R x_i.
fn inverse_depth(pose: &Pose, [x, y]: &Rays) -> f64 {
    let (p, t, y) = (pose.rotation * *x, pose.translation, y.truncate());
    let (a, b) = (p.truncate() - y * p.z, t.truncate() - y * t.z);
    let rho = -a.dot(b) / b.length_squared().max(f64::MIN_POSITIVE);
    if p.z + rho * t.z > 0.0 { rho } else { rho.min(0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_are_derivatives_of_the_epipolar_constraint() {
        let pose = Pose::new(so3::exp(DVec3::new(0.3, -0.5, 0.2)), DVec3::new(2.0, -1.0, 2.0) / 3.0);
        let (d1, d2) = pose.translation.any_orthonormal_pair();
        let x = [DVec3::new(0.3, -0.2, 1.0), DVec3::new(-0.4, 0.6, 1.0)];
        let value = |s: [f64; 5]| {
            let rotation = so3::exp(DVec3::new(s[0], s[1], s[2])) * pose.rotation;
            x[1].dot(essential(&Pose::new(rotation, pose.translation + d1 * s[3] + d2 * s[4])) * x[0])
        };
        for (k, slope) in slopes(&pose, [d1, d2], &x).into_iter().enumerate() {
            let step = |h: f64| value(std::array::from_fn(|i| if i == k { h } else { 0.0 }));
            assert!((slope - (step(1e-5) - step(-1e-5)) / 2e-5).abs() < 1e-9, "unknown {k}");
        }
    }
}
