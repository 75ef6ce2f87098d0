//! Gaussians along the rays of the pixels of a lens, by the book.

use super::{Rendered, center};
use crate::error::RasterError;
use crate::extent::Extent;
use crate::lens::RaysCache;
use crate::settings::{RATIO_FLOOR, RasterSettings};
use crate::tiles::{ALPHA_MIN, TRANSMITTANCE_END};
use weaver_geometry::glam::{DMat3, DQuat, DVec2, DVec3};
use weaver_geometry::lens::Lens;
use weaver_geometry::sh;
use weaver_scene::{CameraSlices, Color, GaussianSlices};

/// One Gaussian as a view sees it.
struct Seen {
    index: usize,
    direction: DVec3,
    distance: f64,
    /// Inverse of the covariance on the plane across the direction, which is 1 along the direction.
    inverse: DMat3,
    opacity: f64,
    color: [f64; 3],
}

/// Draws the whole of the region.
pub(super) fn rasterize(
    gaussians: &GaussianSlices<'_, f64>,
    cameras: &CameraSlices<'_, f64>,
    lens: Lens,
    settings: &RasterSettings,
    extent: &Extent,
) -> Result<Rendered, RasterError> {
    let rays = RaysCache::default().of(cameras)?;
    let pixel_size = |cosine: f64| rays.as_ref().map_or(1.0, |rays| rays.pixel_size(cosine)[0]);
    let projection = lens.projection();
    let mut out = Rendered::default();
    for v in 0..extent.views {
        let mut seen: Vec<Seen> = (0..extent.gaussians)
            .filter_map(|n| see(gaussians, n, &cameras.viewmats[v * cameras.matrix_len()..], settings, &pixel_size))
            .collect();
        seen.sort_by(|a, b| (a.distance as f32).total_cmp(&(b.distance as f32)));
        let background = cameras.background_of(v);
        let [fx, fy, cx, cy] = [0, 1, 2, 3].map(|i| cameras.intrinsics[4 * v + i]);
        for group in 0..extent.groups {
            let of_group = |n: usize| gaussians.groups.is_none_or(|groups| groups.of[n] as usize == group);
            for pixel in 0..extent.region.pixels() {
                let (x, y) = center(&extent.region, pixel);
                let ray = projection.ray(DVec2::new((x - cx) / fx, (y - cy) / fy));
                let (mut light, mut color, mut depth) = (1.0, [0.0; 3], 0.0);
                let mut features = vec![0.0; extent.channels];
                for splat in seen.iter().filter(|splat| of_group(splat.index)) {
                    let alpha = ray.map_or(0.0, |ray| splat.alpha(ray)).min(settings.alpha_max);
                    if alpha < ALPHA_MIN {
                        continue;
                    }
                    let after = light * (1.0 - alpha);
                    if after <= TRANSMITTANCE_END {
                        break;
                    }
                    let weight = alpha * light;
                    (0..3).for_each(|i| color[i] += weight * splat.color[i]);
                    depth += weight * splat.distance;
                    let own = gaussians.features.map_or(&[][..], |features| features.of(splat.index));
                    features.iter_mut().zip(own).for_each(|(sum, x)| *sum += weight * x);
                    light = after;
                }
                if !matches!(gaussians.color, Color::None) {
                    out.image.extend((0..3).map(|i| color[i] + light * background[i]));
                }
                out.alpha.push(1.0 - light);
                out.depth.push(depth);
                out.features.extend(features);
            }
        }
    }
    Ok(out)
}

impl Seen {
    /// Its alpha along a ray of length 1.
    fn alpha(&self, ray: DVec3) -> f64 {
        let cosine = ray.dot(self.direction);
        let way = ray / cosine - self.direction;
        if cosine > 1e-6 { self.opacity * (-0.5 * way.dot(self.inverse * way)).exp() } else { 0.0 }
    }
}

/// A Gaussian by the book; `None` where it is not drawn.
fn see(
    gaussians: &GaussianSlices<'_, f64>,
    index: usize,
    matrix: &[f64],
    settings: &RasterSettings,
    pixel_size: &dyn Fn(f64) -> f64,
) -> Option<Seen> {
    let three = |values: &[f64]| DVec3::from_slice(&values[3 * index..]);
    let axes = DMat3::from_cols_slice(&[0, 4, 8, 1, 5, 9, 2, 6, 10].map(|i| matrix[i]));
    let shift = DVec3::new(matrix[3], matrix[7], matrix[11]);
    let mean = three(gaussians.means);
    let point = axes * mean + shift;
    let (distance, direction) = (point.length(), point.normalize());
    let quat: [f64; 4] = std::array::from_fn(|i| gaussians.quats[4 * index + i]);
    let rotation = DMat3::from_quat(DQuat::from_xyzw(quat[1], quat[2], quat[3], quat[0]).normalize());
    let stretched = axes * rotation * DMat3::from_diagonal(three(gaussians.scales));
    let along = DMat3::from_cols(direction * direction.x, direction * direction.y, direction * direction.z);
    let flat = DMat3::IDENTITY - along;
    let sharp = flat * stretched * stretched.transpose() * flat * (1.0 / (distance * distance));
    let blurred = sharp + flat * (settings.eps2d * pixel_size(direction.z));
    let [sharp_det, det] = [sharp, blurred].map(|plane| (plane + along).determinant());
    let ratio = if settings.antialiased { (sharp_det / det).max(RATIO_FLOOR).sqrt() } else { 1.0 };
    let opacity = gaussians.opacities[index] * ratio;
    let color = match gaussians.color {
        Color::None => [0.0; 3],
        Color::Plain(values) => three(values).to_array(),
        Color::Sh { coefficients, degree } => {
            let terms = (degree + 1) * (degree + 1);
            let basis = sh::basis(degree, (mean + axes.inverse() * shift).normalize().to_array(), |x| x);
            let sum = |i: usize| (0..terms).map(|k| basis[k] * coefficients[3 * (index * terms + k) + i]).sum::<f64>();
            [0, 1, 2].map(|i| (0.5 + sum(i)).max(0.0))
        }
    };
    let drawn = (settings.near..=settings.far).contains(&distance) && det > 0.0;
    drawn.then(|| Seen { index, direction, distance, inverse: (blurred + along).inverse(), opacity, color })
}
