//! Agreement of photos on the colors of points that they share.

use weaver_geometry::glam::DVec3;
use weaver_geometry::lens::LensCamera;
use weaver_kernels::order::median_mean;
use weaver_scene::Photo;
use weaver_scene::PointCloud;

/// Agreement of photos about the colors of the points that they share: the gain of each photo, and how well it explains
/// them.
///
/// The logarithm of the color that photo i shows of point p is `l_ip = g_i + c_p`, a channel at a time; `g` and `c`
/// minimize the sum of `|l_ip - g_i - c_p|`, by medians in turns, so that highlights and hidden points do not count.
/// Gains stand for the photos' own exposure and white balance; their mean is 1.
#[derive(Clone, Debug, PartialEq)]
pub struct ColorAgreement {
    /// Gain of each photo, red, green and blue; 1 where too few points are shared.
    pub gains: Vec<[f32; 3]>,
    /// Median of `|l_ip - c_p|` without gains, of points that gains were not fitted to.
    pub without: f64,
    /// The same with gains.
    pub with: f64,
    /// Points that two photos show or more.
    pub points: usize,
}

/// Turns of the medians.
const TURNS: usize = 20;
/// Mean values darker or brighter than these are clipped in part, and say nothing about gains.
const RANGE: [f32; 2] = [8.0, 247.0];
/// Fewer shared points say nothing.
const LEAST_POINTS: usize = 50;
/// Photos differ in exposure if gains bring points that they were not fitted to together by this factor ...
const BETTER: f64 = 0.9;
/// ... and if half of the gains differ from their mean by this part.
const DIFFERENT: f64 = 0.02;

/// A color that a photo shows of a point.
struct Sample {
    photo: usize,
    point: usize,
    /// Logarithms.
    color: [f64; 3],
}

impl ColorAgreement {
    /// The agreement of photos; each sees the points of these indices.
    ///
    /// Panics unless there are as many lists as photos.
    pub fn of(photos: &[Photo], points: &PointCloud, visible: &[Vec<u32>]) -> Self {
        assert_eq!(photos.len(), visible.len(), "a list of points for each photo");
        let mut samples: Vec<Sample> = Vec::new();
        for (photo, (image, visible)) in photos.iter().zip(visible).enumerate() {
            let camera = image.lens_camera();
            let sample = |point: &u32| {
                let at = DVec3::from(points.positions[*point as usize].map(f64::from));
                Some(Sample { photo, point: *point as usize, color: color(image, &camera, at)? })
            };
            samples.extend(visible.iter().filter_map(sample));
        }
        samples.sort_by_key(|sample| sample.point);
        let shared: Vec<&[Sample]> = samples.chunk_by(|a, b| a.point == b.point).filter(|all| all.len() > 1).collect();
        let half = |odd: usize| shared.iter().skip(odd).step_by(2).copied().collect::<Vec<_>>();
        let none = vec![[0.0; 3]; photos.len()];
        let fitted = gains(&half(0), photos.len());
        // Gains by a few points would be as likely wrong as right.
        let all = if shared.len() < LEAST_POINTS { none.clone() } else { gains(&shared, photos.len()) };
        Self {
            gains: all.iter().map(|gain| gain.map(|g| g.exp() as f32)).collect(),
            without: disagreement(&half(1), &none),
            with: disagreement(&half(1), &fitted),
            points: shared.len(),
        }
    }

    /// Median over photos of the gains' distance from 1, for the largest of the three channels.
    pub fn spread(&self) -> f64 {
        let far = |gain: &[f32; 3]| gain.iter().map(|g| f64::from(g.ln().abs())).fold(0.0, f64::max);
        median_mean(&mut self.gains.iter().map(far).collect::<Vec<_>>()).unwrap_or(0.0)
    }

    /// True if photos differ in exposure or white balance: gains, fitted to half of the points, bring the colors of the
    /// others together.
    pub fn differ(&self) -> bool {
        self.points >= LEAST_POINTS && self.with < BETTER * self.without && self.spread() > DIFFERENT
    }
}

/// The mean of 3 x 3 pixels where a photo shows a point; `None` if that is outside, masked, or too dark or bright.
fn color(photo: &Photo, camera: &LensCamera, point: DVec3) -> Option<[f64; 3]> {
    let (width, height) = (photo.camera.width, photo.camera.height);
    let local = photo.camera.pose.apply(point);
    let at = camera.see(local)?.0.floor();
    let inside = at.x >= 1.0 && at.y >= 1.0 && at.x < width as f64 - 1.0 && at.y < height as f64 - 1.0;
    if !inside {
        return None;
    }
    let (x, y) = (at.x as usize, at.y as usize);
    let pixels = || (y - 1..=y + 1).flat_map(|y| (x - 1..=x + 1).map(move |x| y * width + x));
    if photo.mask.as_ref().is_some_and(|mask| pixels().any(|i| !mask[i])) {
        return None;
    }
    let mean = [0, 1, 2].map(|c| pixels().map(|i| f32::from(photo.rgb[3 * i + c])).sum::<f32>() / 9.0);
    mean.iter().all(|x| (RANGE[0]..=RANGE[1]).contains(x)).then(|| mean.map(|x| f64::from(x).ln()))
}

/// Logarithms of the photos' gains, whose mean is 0.
fn gains(points: &[&[Sample]], photos: usize) -> Vec<[f64; 3]> {
    let mut gains = vec![[0.0; 3]; photos];
    let mut rests: Vec<Vec<f64>> = vec![Vec::new(); photos];
    for _ in 0..TURNS {
        for channel in 0..3 {
            rests.iter_mut().for_each(Vec::clear);
            for samples in points {
                let value = |s: &Sample| s.color[channel] - gains[s.photo][channel];
                let color = median_mean(&mut samples.iter().map(value).collect::<Vec<_>>()).unwrap_or(0.0);
                samples.iter().for_each(|s| rests[s.photo].push(s.color[channel] - color));
            }
            for (gain, rests) in gains.iter_mut().zip(&mut rests).filter(|(_, rests)| !rests.is_empty()) {
                gain[channel] = median_mean(rests).unwrap_or(0.0);
            }
            let mean = gains.iter().map(|gain| gain[channel]).sum::<f64>() / photos as f64;
            gains.iter_mut().for_each(|gain| gain[channel] -= mean);
        }
    }
    gains
}

/// The median difference of a photo's color of a point, without its gain, from the median over photos.
fn disagreement(points: &[&[Sample]], gains: &[[f64; 3]]) -> f64 {
    let mut all = Vec::new();
    for samples in points {
        for channel in [0, 1, 2] {
            let value = |s: &Sample| s.color[channel] - gains[s.photo][channel];
            let color = median_mean(&mut samples.iter().map(value).collect::<Vec<_>>()).unwrap_or(0.0);
            all.extend(samples.iter().map(|s| (value(s) - color).abs()));
        }
    }
    median_mean(&mut all).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::{Camera, Intrinsics, Pose};

    const SIDE: usize = 64;

    /// Photos of one wall of gray squares, each with a gain of its own, its points, and which photo sees which.
    fn wall(gains: &[[f64; 3]]) -> (Vec<Photo>, PointCloud, Vec<Vec<u32>>) {
        let intrinsics = Intrinsics { fx: 64.0, fy: 64.0, cx: 32.0, cy: 32.0 };
        let camera = Camera { pose: Pose::IDENTITY, intrinsics, width: SIDE, height: SIDE };
        let gray = |i: usize| 60.0 + (i / SIDE / 4 * 7 + i % SIDE / 4 * 13) as f64 % 90.0;
        let photo = |(number, gain): (usize, &[f64; 3])| {
            let noise = |i: usize| ((i * 31 + number * 17) % 5) as f64 - 2.0;
            let rgb = (0..SIDE * SIDE).flat_map(|i| gain.map(|g| (g * gray(i) + noise(i)).round() as u8)).collect();
            Photo { name: number.to_string(), camera, rgb, mask: None, lens: None }
        };
        let photos: Vec<Photo> = gains.iter().enumerate().map(photo).collect();
        let middle = |k: usize| (4 * k + 2) as f32 + 0.5;
        let at = |k: usize| [(middle(k % 16) - 32.0) / 64.0, (middle(k / 16) - 32.0) / 64.0, 1.0];
        let positions: Vec<[f32; 3]> = (0..256).map(at).collect();
        let points = PointCloud { colors: vec![[0; 3]; positions.len()], positions };
        let visible = vec![(0..256).collect(); photos.len()];
        (photos, points, visible)
    }

    /// Gains of photos are found and noise is not taken for them.
    #[test]
    fn gains_are_found_and_noise_is_not() {
        let gains = [[1.25, 1.2, 1.2], [1.0, 1.0, 0.95], [0.8, 0.8, 0.8], [1.0, 1.0, 1.1]];
        let (photos, points, visible) = wall(&gains);
        let found = ColorAgreement::of(&photos, &points, &visible);
        assert!(found.differ() && found.points > 200, "{found:?}");
        for channel in 0..3 {
            let mean = gains.iter().map(|gain| gain[channel].ln()).sum::<f64>() / 4.0;
            for (found, gain) in found.gains.iter().zip(&gains) {
                let expected = (gain[channel].ln() - mean).exp();
                assert!((f64::from(found[channel]) / expected - 1.0).abs() < 0.01, "{found:?} {gain:?}");
            }
        }
        let (photos, points, visible) = wall(&[[1.0; 3]; 4]);
        let found = ColorAgreement::of(&photos, &points, &visible);
        assert!(!found.differ() && found.spread() < 0.01, "{found:?}");
    }

    #[test]
    fn photos_without_shared_points_say_nothing() {
        let (photos, points, mut visible) = wall(&[[1.2; 3], [0.8; 3]]);
        visible[0].truncate(128);
        visible[1].drain(..128);
        let found = ColorAgreement::of(&photos, &points, &visible);
        assert_eq!((found.points, found.differ(), found.gains), (0, false, vec![[1.0; 3]; 2]));
        assert!(!ColorAgreement::of(&[], &points, &[]).differ());
    }
}
