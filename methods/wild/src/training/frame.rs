//! Alignment of predictions to the data's world.

use weaver_geometry::glam::{DVec2, DVec3, Vec3};
use weaver_geometry::{Camera, Similarity};

/// Regularization of the fit.
const RIDGE: f64 = 1e-6;
/// Decay of a point's weight with the difference of log depth.
const SHARPNESS: f64 = 10.0;
/// Largest mean weighted squared error of an accepted alignment, training units.
const LARGEST: f64 = 0.5;

/// Depth `[V, H, W]` of the data, 0 if unknown, and its cameras.
#[derive(Clone, Copy, Debug)]
pub(super) struct KnownDepth<'a> {
    pub depth: &'a [f32],
    pub cameras: &'a [Camera],
}

impl KnownDepth<'_> {
    /// The scale s and shift b that align predicted points X^ `[V, H, W, 3]` to the data's points X, by least squares
    /// of s X^ + b - X; `None` if the residual is too large, or no depth is known.
    ///
    /// A point weighs exp(-10 |log z' - log z|), where z' is its depth in another view and z the known depth there, the
    /// mean over the views with a known depth; 1 without any. Source: Fujimura et al., arXiv 2604.21182, and its code.
    pub fn frame(&self, predicted: &[f32]) -> Option<Similarity> {
        let (mut from, mut to, mut weights) = (Vec::new(), Vec::new(), Vec::new());
        for (i, (point, z)) in predicted.as_chunks::<3>().0.iter().zip(self.depth).enumerate() {
            if *z > 0.0 {
                let known = self.point(i, *z);
                from.push(Vec3::from_array(*point).as_dvec3());
                to.push(known);
                weights.push(self.weight(known, i / self.pixels()));
            }
        }
        let found = Similarity::fit_scale_and_shift(&from, &to, &weights, RIDGE)?;
        let error: f64 =
            from.iter().zip(&to).zip(&weights).map(|((f, t), w)| w * found.apply(*f).distance_squared(*t)).sum();
        let close = error / (from.len() as f64) < LARGEST && weights.iter().sum::<f64>() > 0.0;
        (close && found.scale > 0.0).then_some(found)
    }

    fn pixels(&self) -> usize {
        self.cameras[0].width * self.cameras[0].height
    }

    /// The point of pixel `i` of all views at a depth.
    fn point(&self, i: usize, z: f32) -> DVec3 {
        let (camera, pixel) = (&self.cameras[i / self.pixels()], i % self.pixels());
        let center = DVec2::new((pixel % camera.width) as f64, (pixel / camera.width) as f64) + 0.5;
        camera.unproject(center, z.into())
    }

    /// Weight of a point of view `own`, by its agreement with the other views.
    fn weight(&self, point: DVec3, own: usize) -> f64 {
        let (mut sum, mut views) = (0.0, 0.0);
        for (v, camera) in self.cameras.iter().enumerate().filter(|(v, _)| *v != own) {
            let seen = camera.pose.apply(point);
            let at = camera.intrinsics.project(seen).floor();
            let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < camera.width as f64 && at.y < camera.height as f64;
            if seen.z <= 0.0 || !inside {
                continue;
            }
            let z = f64::from(self.depth[v * self.pixels() + at.y as usize * camera.width + at.x as usize]);
            if z > 0.0 {
                sum += (-SHARPNESS * (seen.z / z).ln().abs()).exp();
                views += 1.0;
            }
        }
        if views > 0.0 { sum / views } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_procedural::{ProceduralOptions, scene};

    /// Depth and cameras of two views of a built-in scene.
    fn known() -> (Vec<f32>, Vec<Camera>) {
        let scene = scene(6, &ProceduralOptions { width: 24, height: 16, views: 4 });
        let views = &scene.views[..2];
        let depth = views.iter().flat_map(|view| view.depth.clone().unwrap()).collect();
        (depth, views.iter().map(|view| view.camera).collect())
    }

    fn points(known: &KnownDepth<'_>, moved: impl Fn(DVec3) -> DVec3) -> Vec<f32> {
        let all = known.depth.iter().enumerate();
        all.flat_map(|(i, z)| moved(known.point(i, z.max(0.1))).as_vec3().to_array()).collect()
    }

    /// Promise of `published_gaussians_lie_behind_the_depth`.
    #[test]
    fn a_planted_frame_is_found() {
        let (depth, cameras) = known();
        let known = KnownDepth { depth: &depth, cameras: &cameras };
        let shift = DVec3::new(0.3, -0.2, 0.5);
        let found = known.frame(&points(&known, |x| (x - shift) / 1.7)).unwrap();
        assert!((found.scale - 1.7).abs() < 1e-5 && (found.translation - shift).length() < 1e-5, "{found:?}");
    }

    /// Promise of `published_gaussians_lie_behind_the_depth`.
    #[test]
    fn outliers_of_frames_weigh_little() {
        let (depth, cameras) = known();
        let known = KnownDepth { depth: &depth, cameras: &cameras };
        let weights: Vec<f64> = (0..depth.len() / 2)
            .filter(|i| depth[*i] > 0.0)
            .map(|i| known.weight(known.point(i, depth[i]), 0))
            .collect();
        let agree = weights.iter().filter(|w| **w > 0.8).count();
        assert!(agree > weights.len() / 2 && agree < weights.len(), "{agree} of {}", weights.len());
        // Points in no order, ten times as far apart as the scene is wide.
        let nonsense: Vec<f32> = (0..3 * depth.len()).map(|i| ((i * 7919) % 211) as f32 - 105.0).collect();
        let far = KnownDepth { depth: &depth.iter().map(|z| 10.0 * z).collect::<Vec<_>>(), cameras: &cameras };
        assert!(far.frame(&nonsense).is_none());
        assert!(KnownDepth { depth: &vec![0.0; depth.len()], cameras: &cameras }.frame(&nonsense).is_none());
    }
}
