//! Gaussians to start from: on points, at random, or of another scene.

use crate::FitError;
use crate::population::{Population, logit};
use crate::settings::FitSettings;
use crate::strategy::split;
use weaver_geometry::Camera;
use weaver_geometry::glam::{DMat3, DVec2, DVec3};
use weaver_geometry::lens::LensCamera;
use weaver_kernels::nearest_neighbors::nearest_neighbors;
use weaver_kernels::order::{median_high, nth};
use weaver_kernels::parallel;
use weaver_kernels::random::Stream;
use weaver_scene::Photo;
use weaver_scene::{Gaussians, PointCloud, forms};

/// Isotropic Gaussians on points, in their colors, as large as the mean distance of their three nearest neighbors times
/// [`FitSettings::initial_scale`].
///
/// Of more points than the initial part of the budget a random part is taken; of equal points one.
///
/// # Errors
/// When there are no points.
pub fn from_points(points: &PointCloud, settings: &FitSettings) -> Result<Gaussians, FitError> {
    let room = room(settings);
    let stream = Stream::new(settings.seed, 0, "fit.points");
    let finite = |n: &usize| points.positions[*n].iter().all(|x| x.is_finite());
    let mut chosen: Vec<usize> = stream.permutation(points.len()).into_iter().filter(finite).collect();
    chosen.sort_by(|a, b| {
        let key = |n: &usize| points.positions[*n].map(f32::to_bits);
        key(a).cmp(&key(b)).then(a.cmp(b))
    });
    chosen.dedup_by_key(|n| points.positions[*n].map(f32::to_bits));
    let order = stream.fork(1).permutation(chosen.len());
    let mut chosen: Vec<usize> = order.into_iter().take(room).map(|i| chosen[i]).collect();
    chosen.sort_unstable();
    if chosen.is_empty() {
        return Err(FitError::setting("init", "points in the capture (or another way to begin)", "none"));
    }
    let means: Vec<[f32; 3]> = chosen.iter().map(|n| points.positions[*n]).collect();
    let colors: Vec<[f32; 3]> = chosen.iter().map(|n| points.colors[*n].map(|c| f32::from(c) / 255.0)).collect();
    Ok(isotropic(means, &colors, settings))
}

/// Range of random depths, over the distance to the cameras' focus.
const NEAREST: f64 = 0.5;
const FARTHEST: f64 = 5.0;
/// Draws of something that has to meet a condition before it may be without.
const TRIES: u64 = 64;

/// Gaussians at random places that photos see, in the colors of the pixels that see them: a random pixel of a random
/// photo, at a depth whose inverse is uniform between 0.5 and 5 times the distance to the cameras' focus, and no nearer
/// before the other cameras if such a place is found. Masked pixels are left out.
///
/// # Errors
/// When there are no photos, or all are masked.
pub fn random(photos: &[Photo], settings: &FitSettings) -> Result<Gaussians, FitError> {
    let photos: Vec<&Photo> = photos.iter().filter(|photo| !photo.is_masked()).collect();
    if photos.is_empty() {
        return Err(FitError::setting("photos", "at least one with pixels that count", "none"));
    }
    let middle = looked_at(&photos);
    let cameras: Vec<LensCamera> = photos.iter().map(|photo| photo.lens_camera()).collect();
    let stream = Stream::new(settings.seed, 0, "fit.random");
    let (mut means, mut colors) = (Vec::new(), Vec::new());
    for i in 0..room(settings) as u64 {
        let draw = |attempt: u64| {
            let stream = stream.fork(attempt);
            let number = stream.below(3 * i, photos.len());
            let (photo, camera) = (photos[number], &cameras[number]);
            let pixel = drawn_pixel(photo, stream, 3 * i + 1);
            let inverse = FARTHEST.recip() + (NEAREST.recip() - FARTHEST.recip()) * stream.uniform::<f64>(3 * i + 2);
            let Camera { pose, width, .. } = photo.camera;
            let at = DVec2::new((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
            let depth = pose.apply(middle).length() / inverse;
            let color = std::array::from_fn(|c| f32::from(photo.rgb[3 * pixel + c]) / 255.0);
            // Pixels beyond a lens's circle are masked.
            let local = camera.point(at, depth).unwrap_or(DVec3::Z * depth);
            (pose.inverse().apply(local), color)
        };
        let free = |point: DVec3| {
            let near = |p: &LensCamera| {
                let depth = depth_in(p, point);
                depth.is_some_and(|z| z < NEAREST * p.camera.pose.apply(middle).length())
            };
            !cameras.iter().any(near)
        };
        let (point, color) = (0..TRIES).map(draw).find(|(point, _)| free(*point)).unwrap_or_else(|| draw(0));
        means.push(point.as_vec3().to_array());
        colors.push(color);
    }
    Ok(isotropic(means, &colors, settings))
}

/// A random part of Gaussians, in their order, no more than `count`.
pub fn part_of(gaussians: &Gaussians, count: usize, seed: u64) -> Gaussians {
    let mut chosen = Stream::new(seed, 0, "fit.part").permutation(gaussians.len());
    chosen.truncate(count);
    chosen.sort_unstable();
    rows(gaussians, &chosen, gaussians.degree)
}

/// A random pixel that counts; where few of them do, the one that follows a random pixel.
fn drawn_pixel(photo: &Photo, stream: Stream, index: u64) -> usize {
    let pixels = photo.camera.width * photo.camera.height;
    let counts = |i: &usize| photo.mask.as_ref().is_none_or(|mask| mask[*i]);
    let any = |k: u64| stream.fork(k).below(index, pixels);
    let first = any(0);
    let next = || (first..pixels).chain(0..first).find(counts).unwrap_or(first);
    (0..TRIES).map(any).find(counts).unwrap_or_else(next)
}

/// Gaussians of another scene, of more than the budget the most opaque.
///
/// # Errors
/// When there are none, or their fields disagree.
pub fn from_gaussians(gaussians: &Gaussians, settings: &FitSettings) -> Result<Gaussians, FitError> {
    if gaussians.is_empty() {
        return Err(FitError::setting("init", "at least one Gaussian", "none"));
    }
    if !gaussians.lengths_agree() {
        let found = format!("others beside {} means", gaussians.len());
        return Err(FitError::setting("init", "Gaussians with fields of equal length", found));
    }
    let finite = |n: &usize| {
        let (m, s, q) = (gaussians.means[*n], gaussians.log_scales[*n], gaussians.quats[*n]);
        m.iter().chain(&s).chain(&q).all(|x| x.is_finite()) && q.iter().any(|x| *x != 0.0)
    };
    let mut chosen: Vec<usize> = (0..gaussians.len()).filter(finite).collect();
    let opacity = |n: &usize| gaussians.opacity_logits[*n];
    chosen.sort_by(|a, b| opacity(b).total_cmp(&opacity(a)).then(a.cmp(b)));
    chosen.truncate(settings.gaussians);
    chosen.sort_unstable();
    if chosen.is_empty() {
        return Err(FitError::setting("init", "Gaussians with finite numbers", "none"));
    }
    let mut kept = rows(gaussians, &chosen, gaussians.degree.min(settings.sh_degree));
    // Infinite logits are opacities of 0 and 1; neither could be learned from.
    kept.opacity_logits.iter_mut().for_each(|o| *o = o.clamp(-9.0, 9.0));
    Ok(kept)
}

/// Some Gaussians, with harmonics up to a degree.
fn rows(gaussians: &Gaussians, chosen: &[usize], degree: usize) -> Gaussians {
    let wide = 3 * gaussians.coefficients();
    let kept = 3 * weaver_geometry::sh::coefficients(degree);
    Gaussians {
        means: chosen.iter().map(|n| gaussians.means[*n]).collect(),
        log_scales: chosen.iter().map(|n| gaussians.log_scales[*n]).collect(),
        quats: chosen.iter().map(|n| gaussians.quats[*n]).collect(),
        opacity_logits: chosen.iter().map(|n| gaussians.opacity_logits[*n]).collect(),
        sh: chosen.iter().flat_map(|n| gaussians.sh[n * wide..][..kept].iter().copied()).collect(),
        degree,
    }
}

/// Gaussians split at random, each once before any of them is split again, until there are `count`: a scene of that
/// many which are spread as evenly as those given.
pub fn divided(gaussians: &Gaussians, count: usize, seed: u64) -> Gaussians {
    let mut population = Population::new(gaussians);
    for round in 0.. {
        let now = population.len();
        if now == 0 || now >= count {
            break;
        }
        let order = Stream::new(seed, round, "fit.divided").permutation(now);
        order.into_iter().take(count - now).for_each(|n| split(&mut population, n));
    }
    population.to_gaussians(gaussians.degree)
}

/// Largest number of Gaussians at the beginning, so that density control has room to work in.
pub fn room(settings: &FitSettings) -> usize {
    let part = match settings.density.strategy {
        crate::StrategyKind::Keep => 1.0,
        _ => settings.density.initial_part,
    };
    ((settings.gaussians as f64 * part) as usize).max(1)
}

/// Largest standard deviation of an initial Gaussian over its depth, times the root of their number: some three times
/// what they would have if they were spread evenly over all directions.
const LARGEST: f64 = 5.0;

/// Gaussians with standard deviations of at most `5 / sqrt(n)` times the depth at which the nearest photo shows them,
/// `n` their number.
///
/// A point that stands alone is as far from its neighbors as the scene is large. If it also stands close to a camera,
/// its Gaussian is a veil before all that this camera sees: of a statue in a hall, 178 photos, a third of the Gaussians
/// were larger, and 500 steps ended 1.9 dB lower.
pub fn bounded(mut gaussians: Gaussians, photos: &[Photo]) -> Gaussians {
    let cameras: Vec<LensCamera> = photos.iter().map(Photo::lens_camera).collect();
    let part = LARGEST / (gaussians.len().max(1) as f64).sqrt();
    let means = &gaussians.means;
    parallel::for_chunks(&mut gaussians.log_scales, 1, |n, scales| {
        let point = DVec3::from(means[n].map(f64::from));
        if let Some(nearest) = cameras.iter().filter_map(|camera| depth_in(camera, point)).min_by(f64::total_cmp) {
            let largest = (part * nearest).ln() as f32;
            scales[0].iter_mut().for_each(|scale| *scale = scale.min(largest));
        }
    });
    gaussians
}

fn isotropic(means: Vec<[f32; 3]>, colors: &[[f32; 3]], settings: &FitSettings) -> Gaussians {
    let n = means.len();
    let mut neighbors = vec![0; 4 * n];
    nearest_neighbors(means.as_flattened(), 3, &mut neighbors);
    let distance = |a: [f32; 3], b: [f32; 3]| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f32>().sqrt();
    let scales: Vec<f32> = (neighbors.chunks_exact(4).enumerate())
        .map(|(n, near)| near[1..].iter().map(|m| distance(means[n], means[*m as usize])).sum::<f32>() / 3.0)
        .collect();
    // Where a point stands alone.
    let mut apart: Vec<f32> = scales.iter().copied().filter(|s| *s > 0.0).collect();
    let median = median_high(&mut apart).unwrap_or(1.0);
    let log_scale = |s: f32| {
        let distance = if s > 0.0 { s } else { median };
        (distance * settings.initial_scale).ln()
    };
    Gaussians {
        log_scales: scales.iter().map(|s| [log_scale(*s); 3]).collect(),
        quats: vec![[1.0, 0.0, 0.0, 0.0]; n],
        opacity_logits: vec![logit(settings.initial_opacity); n],
        sh: colors.iter().flatten().map(|c| forms::harmonic(*c)).collect(),
        degree: 0,
        means,
    }
}

/// The depth of a point that a camera sees.
fn depth_in(lens: &LensCamera, point: DVec3) -> Option<f64> {
    let camera = &lens.camera;
    let (at, depth) = lens.see(camera.pose.apply(point))?;
    let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < camera.width as f64 && at.y < camera.height as f64;
    inside.then_some(depth)
}

/// The 1 % quantile of the depths at which photos see these points; where they see nothing, the distance to the
/// cameras' focus.
pub(crate) fn first_depth(photos: &[Photo], points: &[[f32; 3]]) -> f64 {
    let mut depths: Vec<f64> = Vec::new();
    for photo in photos {
        let camera = photo.lens_camera();
        depths.extend(points.iter().filter_map(|point| depth_in(&camera, DVec3::from(point.map(f64::from)))));
    }
    let hundredth = depths.len() / 100;
    nth(&mut depths, hundredth).unwrap_or_else(|| {
        let photos: Vec<&Photo> = photos.iter().collect();
        let middle = looked_at(&photos);
        photos.first().map_or(1.0, |photo| photo.camera.pose.center().distance(middle))
    })
}

/// The point nearest to all optical axes, in the sense of least squares; where they are (nearly) parallel, a point
/// before the cameras, as far as they are apart.
pub(crate) fn looked_at(photos: &[&Photo]) -> DVec3 {
    let (mut matrix, mut sum) = (DMat3::ZERO, DVec3::ZERO);
    let (mut center, mut forward) = (DVec3::ZERO, DVec3::ZERO);
    for photo in photos {
        let pose = &photo.camera.pose;
        let axis = pose.rotation.row(2);
        let across = DMat3::IDENTITY - DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        matrix += across;
        sum += across * pose.center();
        center += pose.center() / photos.len() as f64;
        forward += axis / photos.len() as f64;
    }
    let spread = photos.iter().map(|p| p.camera.pose.center().distance(center)).sum::<f64>() / photos.len() as f64;
    let fallback = center + forward.normalize_or(DVec3::Z) * if spread > 0.0 { 4.0 * spread } else { 1.0 };
    if matrix.determinant() < 1e-3 * (photos.len() as f64).powi(3) {
        return fallback;
    }
    let point = matrix.inverse() * sum;
    let before = photos.iter().filter(|p| p.camera.pose.apply(point).z > 0.0).count();
    if 2 * before > photos.len() { point } else { fallback }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::{Intrinsics, Pose};

    /// Promise (scenes): no Gaussian of the start is a veil before a camera: what stands alone begins no larger than
    /// the nearest photo that shows it allows, and everything else as large as it was.
    #[test]
    fn no_gaussian_begins_as_a_veil() {
        let intrinsics = Intrinsics { fx: 40.0, fy: 40.0, cx: 20.0, cy: 15.0 };
        let photo = |forward: f64| {
            let pose = Pose::new(DMat3::IDENTITY, DVec3::new(0.0, 0.0, -forward));
            let camera = Camera { pose, intrinsics, width: 40, height: 30 };
            Photo { name: "photo".into(), camera, rgb: vec![0; 3 * 40 * 30].into(), mask: None, lens: None }
        };
        let photos = [0.0, 9.0].map(photo);
        // Before both, before the farther one alone, and behind both.
        let means = vec![[0.0, 0.0, 10.0], [0.0, 0.0, 5.0], [0.0, 0.0, -5.0], [0.0, 0.0, 10.0]];
        let log_scales = vec![[3.0, 0.0, 3.0], [3.0; 3], [3.0; 3], [-9.0; 3]];
        let n = means.len();
        let gaussians = Gaussians {
            means,
            log_scales,
            quats: vec![[1.0, 0.0, 0.0, 0.0]; n],
            opacity_logits: vec![0.0; n],
            sh: vec![0.0; 3 * n],
            degree: 0,
        };
        let part = LARGEST as f32 / 2.0;
        let [at_one, at_five] = [part.ln(), (5.0 * part).ln()];
        let expected = [[at_one, 0.0, at_one], [at_five; 3], [3.0; 3], [-9.0; 3]];
        let found = bounded(gaussians.clone(), &photos);
        for (found, expected) in found.log_scales.as_flattened().iter().zip(expected.as_flattened()) {
            assert!((found - expected).abs() < 1e-6, "{found}, not {expected}");
        }
        assert_eq!(Gaussians { log_scales: gaussians.log_scales.clone(), ..found.clone() }, gaussians);
        assert_eq!(bounded(found.clone(), &photos), found, "bounds of what is bounded change nothing");
    }
}
