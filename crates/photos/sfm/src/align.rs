//! Keypoints moved until their surroundings agree across photos.

mod patch;

use crate::bundle::{Bundle, Observation};
use crate::photo::Photo;
use patch::{Gray, Template};
use weaver_geometry::Camera;
use weaver_geometry::glam::{DMat2, DVec2, DVec3};
use weaver_kernels::{parallel, simd};

/// Least similarity of the surroundings of two observations to be aligned: their normalized correlation.
const ALIKE: f32 = 0.8;
/// Largest movement of an observation, over its deviation; and the least deviation that counts here, pixels.
const MOVES: f64 = 1.5;
const LEAST: f64 = 0.3;
/// The deviation of aligned keypoints, pixels.
const ALIGNED: f64 = 0.25;
/// Pixels from one sample of a template to the next, by the deviation of its observation.
const SPACING: [f64; 2] = [1.0, 1.5];
/// Points of a task.
const GRAIN: usize = 16;

impl Bundle {
    /// Moves the observations of each point to the place where the surroundings agree across its photos.
    ///
    /// Keypoints are found in each photo alone, and off by a part of their scale. The photo nearest the middle of all
    /// viewing directions of a point makes a template. Each other photo begins at its keypoint, warped as a plane
    /// across that middle direction, and is aligned by affine steps, brightness and contrast aside. Patches that do not
    /// match in the end, or moved too far, stay as they were.
    ///
    /// With the template's values `t`, its slopes `J` by the six numbers of an affine movement, and the photo's values
    /// `v` brought to the brightness and contrast of the template, a step is `(J^T J)^-1 J^T (v - t)`, and its inverse
    /// moves the patch. Nothing is differentiable.
    ///
    /// Sources: Baker and Matthews, Lucas-Kanade 20 years on, 2004 (inverse compositional steps); Furukawa and Ponce,
    /// Accurate camera calibration from multi-view stereo and bundle adjustment, 2009.
    ///
    /// # Panics
    /// If the numbers of photos and cameras differ, or a photo has not its camera's size.
    ///
    /// ```
    /// use weaver_geometry::glam::{DVec2, DVec3};
    /// use weaver_geometry::{Camera, Intrinsics, Pose};
    /// use weaver_sfm::{Bundle, Lens, Observation, Photo};
    ///
    /// // Two cameras side by side look at waves on a wall: what one sees at x, the other does at x - 10.
    /// let (width, height) = (64, 48);
    /// let wave = |x: f64, y: f64| 128.0 + 40.0 * ((0.5 * x + 0.2 * y).sin() + (0.3 * x - 0.4 * y).cos());
    /// let photo = |shift: f64| {
    ///     let gray = move |i: usize| wave((i % width) as f64 + shift, (i / width) as f64) as u8;
    ///     Photo::new((0..width * height).flat_map(|i| [gray(i); 3]).collect::<Vec<u8>>(), [height, width])
    /// };
    /// let intrinsics = Intrinsics { fx: 50.0, fy: 50.0, cx: 32.0, cy: 24.0 };
    /// let camera = |x: f64| Camera { pose: Pose::new(Default::default(), DVec3::new(x, 0.0, 0.0)), intrinsics, width, height };
    /// // The second keypoint is off by most of a pixel.
    /// let seen = |camera, x, y| Observation { camera, point: 0, pixel: DVec2::new(x, y), deviation: 1.0 };
    /// let mut bundle = Bundle {
    ///     cameras: vec![camera(0.0), camera(-1.0)],
    ///     points: vec![DVec3::new(0.0, 0.0, 5.0)],
    ///     observations: vec![seen(0, 32.0, 24.0), seen(1, 22.5, 23.6)],
    ///     lenses: vec![Lens::default()],
    ///     lens_of: vec![0, 0],
    ///     fixed: vec![false; 2],
    ///     ..Bundle::default()
    /// };
    /// bundle.align(&[&photo(0.0), &photo(10.0)]);
    /// let apart = bundle.observations[0].pixel - bundle.observations[1].pixel;
    /// assert!(apart.distance(DVec2::new(10.0, 0.0)) < 0.05, "{apart}");
    /// ```
    pub fn align(&mut self, photos: &[&Photo<'_>]) {
        let sizes = photos.iter().map(|photo| photo.size);
        assert!(sizes.eq(self.cameras.iter().map(|camera| [camera.height, camera.width])), "photos of the cameras");
        let cameras: Vec<Camera> = (0..self.cameras.len()).map(|i| self.camera(i)).collect();
        let points = &self.points;
        let mut grays: Vec<Option<Gray>> = vec![None; photos.len()];
        parallel::for_chunks(&mut grays, 1, |i, gray| gray[0] = Some(Gray::of(photos[i])));
        let grays: Vec<Gray> = grays.into_iter().flatten().collect();
        let mut seen: Vec<&mut [Observation]> =
            self.observations.chunk_by_mut(|a, b| a.point == b.point).filter(|seen| seen.len() > 1).collect();
        parallel::for_chunks(&mut seen, GRAIN, |_, seen| {
            simd::dispatch(
                #[inline(always)]
                || seen.iter_mut().for_each(|seen| align(&grays, &cameras, points[seen[0].point], seen)),
            );
        });
    }
}

/// Aligns the observations of one point.
#[inline(always)]
fn align(photos: &[Gray], cameras: &[Camera], point: DVec3, seen: &mut [Observation]) {
    let toward = |o: &Observation| (cameras[o.camera].pose.center() - point).normalize_or_zero();
    let normal = seen.iter().map(toward).sum::<DVec3>().normalize_or_zero();
    let Some(middle) = (0..seen.len()).max_by(|a, b| {
        let [a, b] = [a, b].map(|i| toward(&seen[*i]).dot(normal));
        a.total_cmp(&b)
    }) else {
        return;
    };
    if normal == DVec3::ZERO {
        return;
    }
    let plane = normal.any_orthonormal_pair();
    let Observation { camera, pixel, deviation, .. } = seen[middle];
    let onto_plane = looks(&cameras[camera], point, plane).inverse();
    let spacing = DMat2::IDENTITY * deviation.clamp(SPACING[0], SPACING[1]);
    let Some(template) = Template::new(&photos[camera], pixel, spacing).filter(|_| onto_plane.is_finite()) else {
        return;
    };
    let mut any = false;
    for o in seen.iter_mut().filter(|o| o.camera != camera) {
        let warp = looks(&cameras[o.camera], point, plane) * onto_plane * spacing;
        let Some((at, alike)) = template.aligned(&photos[o.camera], o.pixel, warp) else { continue };
        if alike > ALIKE && at.distance(o.pixel) < MOVES * o.deviation.max(LEAST) {
            (o.pixel, o.deviation, any) = (at, ALIGNED, true);
        }
    }
    if any {
        seen[middle].deviation = ALIGNED;
    }
}

/// Projection of offsets from a point along two directions, pixels.
fn looks(camera: &Camera, point: DVec3, (u, v): (DVec3, DVec3)) -> DMat2 {
    let at = camera.pose.apply(point);
    let k = &camera.intrinsics;
    let slope = |along: DVec3| {
        let along = camera.pose.rotation * along;
        DVec2::new(k.fx * (along.x - at.x / at.z * along.z), k.fy * (along.y - at.y / at.z * along.z)) / at.z
    };
    DMat2::from_cols(slope(u), slope(v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bundle::Lens;
    use weaver_geometry::{Intrinsics, Pose, so3};
    use weaver_kernels::order::median_high;
    use weaver_kernels::random::Stream;

    /// A wavy picture on the plane z = 0, seen by cameras from different sides; keypoints off by some part of a pixel.
    fn scene(noise: f64) -> (Bundle, Vec<Photo<'static>>) {
        let (width, height) = (160, 120);
        let intrinsics = Intrinsics { fx: 150.0, fy: 150.0, cx: 80.0, cy: 60.0 };
        let draw = |k: usize| Stream::new(2, 0, "align").normal::<f64>(k as u64);
        let camera = |i: usize| {
            let turn = so3::exp(DVec3::new(0.2 * (i as f64 - 1.5), 0.25 * (1.5 - i as f64), 0.1 * i as f64));
            let pose = Pose::new(turn, DVec3::new(0.0, 0.0, 2.0));
            Camera { pose, intrinsics, width, height }
        };
        let cameras: Vec<Camera> = (0..4).map(camera).collect();
        let value = |p: DVec2| {
            let wave = |k: f64, turn: f64| (k * (p.x * turn.cos() + p.y * turn.sin()) + 5.0 * turn).sin();
            0.5 + 0.1 * (wave(31.0, 0.2) + wave(24.0, 1.3) + wave(41.0, 2.1) + wave(19.0, 2.8))
        };
        let photo = |camera: &Camera| {
            let byte = |i: usize| {
                let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
                let ray = camera.pose.rotation.transpose() * camera.intrinsics.unproject(pixel, 1.0);
                let center = camera.pose.center();
                (255.0 * value((center - ray * (center.z / ray.z)).truncate())).round() as u8
            };
            Photo::new((0..width * height).flat_map(|i| [byte(i); 3]).collect::<Vec<u8>>(), [height, width])
        };
        let photos = cameras.iter().map(photo).collect();
        let mut bundle = Bundle {
            lenses: vec![Lens::default()],
            lens_of: vec![0; cameras.len()],
            fixed: vec![false; cameras.len()],
            ..Bundle::default()
        };
        for point in 0..40 {
            bundle.points.push(DVec3::new(0.25 * draw(2 * point), 0.2 * draw(2 * point + 1), 0.0));
            for (camera, from) in cameras.iter().enumerate() {
                let at = 1000 + 2 * (4 * point + camera);
                let pixel = intrinsics.project(from.pose.apply(bundle.points[point]));
                let pixel = pixel + noise * DVec2::new(draw(at), draw(at + 1));
                bundle.observations.push(Observation { camera, point, pixel, deviation: 1.0 });
            }
        }
        (Bundle { cameras, ..bundle }, photos)
    }

    /// Median distance of observations from the template's, over the photos.
    fn off(bundle: &Bundle) -> f64 {
        let exact = scene(0.0).0;
        let apart = |seen: (&[Observation], &[Observation])| -> f64 {
            // All of a point may move together.
            let by: Vec<DVec2> = seen.0.iter().zip(seen.1).map(|(a, b)| a.pixel - b.pixel).collect();
            let mean = by.iter().sum::<DVec2>() / by.len() as f64;
            (by.iter().map(|by| by.distance_squared(mean)).sum::<f64>() / by.len() as f64).sqrt()
        };
        let mut each: Vec<f64> = bundle.observations.chunks(4).zip(exact.observations.chunks(4)).map(apart).collect();
        median_high(&mut each).expect("observations")
    }

    /// Promise (figures): keypoints are aligned to where photos agree, in bent and lit patches.
    #[test]
    fn keypoints_move_to_where_photos_agree() {
        let (mut bundle, photos) = scene(0.4);
        let photos: Vec<&Photo<'_>> = photos.iter().collect();
        let before = off(&bundle);
        bundle.align(&photos);
        let after = off(&bundle);
        assert!(before > 0.4 && after < 0.15, "{before} -> {after}");
        let aligned = bundle.observations.iter().filter(|o| o.deviation == ALIGNED).count();
        assert!(10 * aligned > 8 * bundle.observations.len(), "{aligned} of {}", bundle.observations.len());
    }
}
