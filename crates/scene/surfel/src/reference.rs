//! The same drawing pixel by pixel in `f64`, by vectors in space: slow, to test against.

use crate::response::GRAZING;
use crate::surfels::Surfel;
use crate::{RangeImages, Sight};
use weaver_geometry::glam::DVec2;
use weaver_kernels::Real;
use weaver_splat::tiles::{ALPHA_MIN, TRANSMITTANCE_END};

/// Images of a dense loop over all surfels at all pixels, with median range and distortion.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReferenceImages {
    /// Range, opacity and normals.
    pub images: RangeImages<f64>,
    /// `[V, H, W]`
    pub median: Vec<f64>,
    /// `[V, H, W]`
    pub distortion: Vec<f64>,
}

/// Draws as [`SurfelWorkspace::draw`](crate::SurfelWorkspace::draw), without tiles or lists.
pub fn draw<T: Real>(sight: &Sight<'_, T>) -> ReferenceImages {
    let mut all = ReferenceImages::default();
    let camera = sight.camera;
    for pose in sight.poses {
        let mut order: Vec<Surfel> = (0..sight.surfels.len()).map(|n| sight.surfels.placed(n, pose)).collect();
        let visible = |s: &Surfel| {
            let distance = s.center.length();
            distance > sight.limits.near && distance <= sight.limits.far && s.axes[2].dot(s.center) < 0.0
        };
        order.retain(visible);
        // As the lists are ordered: by the distance in 32 bits.
        order.sort_by(|a, b| (a.center.length() as f32).total_cmp(&(b.center.length() as f32)));
        for row in 0..camera.height {
            for column in 0..camera.width {
                pixel(sight, &order, DVec2::new(column as f64 + 0.5, row as f64 + 0.5), &mut all);
            }
        }
    }
    all
}

fn pixel<T: Real>(sight: &Sight<'_, T>, order: &[Surfel], at: DVec2, all: &mut ReferenceImages) {
    let camera = sight.camera;
    let ray = camera.ray(at);
    let (mut left, mut range, mut normal, mut median) = (1.0, 0.0, [0.0; 3], 0.0);
    let mut met: Vec<[f64; 2]> = Vec::new();
    for Surfel { center, axes: [t1, t2, n], scales: [s1, s2], opacity } in order {
        let toward = n.dot(ray);
        let r = n.dot(*center) / toward;
        if r <= 0.0 || toward.abs() < GRAZING {
            continue;
        }
        let offset = ray * r - *center;
        let (a, b) = (offset.dot(*t1) / s1, offset.dot(*t2) / s2);
        let sigma = (a * a + b * b) / 2.0;
        let mut away = camera.project(*center) - at;
        if camera.period().is_some() {
            let width = camera.width as f64;
            away.x -= width * (away.x / width).round();
        }
        let low_pass = away.length_squared();
        let (sigma, r) = if low_pass < sigma { (low_pass, center.length()) } else { (sigma, r) };
        let alpha = (opacity * (-sigma).exp()).min(sight.limits.alpha_max);
        if alpha < ALPHA_MIN {
            continue;
        }
        if left * (1.0 - alpha) <= TRANSMITTANCE_END {
            break;
        }
        let w = alpha * left;
        if left > 0.5 {
            median = r;
        }
        range += w * r;
        (0..3).for_each(|i| normal[i] += w * n[i]);
        met.push([w, r]);
        left *= 1.0 - alpha;
    }
    let pairs = met.iter().enumerate().flat_map(|(i, a)| met[..i].iter().map(move |b| (a, b)));
    all.distortion.push(pairs.map(|(a, b)| a[0] * b[0] * (a[1] - b[1]).powi(2)).sum());
    all.median.push(median);
    all.images.range.push(range);
    all.images.opacity.push(1.0 - left);
    all.images.normal.extend(normal);
}
