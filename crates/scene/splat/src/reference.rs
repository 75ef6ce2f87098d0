//! The rasterizer again, slowly and in another way, to test against: every Gaussian at every pixel, in `f64`, from
//! the textbook's formulas, with the derivatives of projection by forward-mode dual numbers. No tiles, no bounds, no
//! threads.

mod projection;
mod rays;

use crate::error::RasterError;
use crate::extent::Extent;
use crate::gradients::Cotangents;
use crate::settings::RasterSettings;
use crate::statistics::GaussianStatistics;
use crate::tiles::{ALPHA_MIN, Region, TRANSMITTANCE_END};
use projection::{Seen, VARIABLES, features_of, see_all};
use weaver_scene::{CameraSlices, Color, GaussianSlices, Model};

/// Images by the reference, shaped as by [`crate::rasterize`].
#[derive(Clone, Debug, Default)]
pub struct Rendered {
    /// `[V, H, W, 3]`
    pub image: Vec<f64>,
    /// `[V, H, W]`
    pub alpha: Vec<f64>,
    /// `[V, H, W]`
    pub depth: Vec<f64>,
    /// `[V, H, W, C]`
    pub features: Vec<f64>,
}

/// Gradients by the reference, shaped as by [`crate::rasterize_backward`].
#[derive(Clone, Debug, Default)]
pub struct RenderedBackward {
    /// `[N, 3]`
    pub means: Vec<f64>,
    /// `[N, 4]`
    pub quats: Vec<f64>,
    /// `[N, 3]`
    pub scales: Vec<f64>,
    /// `[N]`
    pub opacities: Vec<f64>,
    /// `[N, 3]` or `[N, K, 3]`
    pub colors: Vec<f64>,
    /// `[N, C]`
    pub features: Vec<f64>,
    /// As the view matrices.
    pub viewmats: Vec<f64>,
    /// `[V, 4]`
    pub intrinsics: Vec<f64>,
    /// As the background.
    pub background: Vec<f64>,
    /// `[N]`
    pub statistics: Vec<GaussianStatistics<f64>>,
}

/// The gradient with respect to a [`Seen`]'s ten numbers, in its order.
type SeenGradient = [f64; 10];

/// One splat at one pixel.
struct Touch {
    /// Index among the sorted ones.
    at: usize,
    dx: f64,
    dy: f64,
    alpha: f64,
    capped: bool,
    /// T in front of it.
    before: f64,
}

/// Blends one pixel; returns the splats that touch it, and the transmittance left.
fn blend(seen: &[Seen], settings: &RasterSettings, x: f64, y: f64) -> (Vec<Touch>, f64) {
    let mut touches = Vec::new();
    let mut transmittance = 1.0;
    for (at, splat) in seen.iter().enumerate() {
        let (dx, dy) = (x - splat.center[0].value, y - splat.center[1].value);
        let [a, b, c] = splat.conic.map(|n| n.value);
        let sigma = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy;
        let raw = splat.opacity.value * (-sigma).exp();
        let alpha = raw.min(settings.alpha_max);
        if sigma < 0.0 || alpha < ALPHA_MIN {
            continue;
        }
        let after = transmittance * (1.0 - alpha);
        if after <= TRANSMITTANCE_END {
            break;
        }
        touches.push(Touch { at, dx, dy, alpha, capped: raw > settings.alpha_max, before: transmittance });
        transmittance = after;
    }
    (touches, transmittance)
}

/// The views of all pictures, and the groups that these show.
fn pictures(extent: &Extent) -> impl Iterator<Item = (usize, usize)> {
    let groups = extent.groups;
    (0..extent.views).flat_map(move |v| (0..groups).map(move |group| (v, group)))
}

/// Projects a group into a view.
fn see_group(
    gaussians: &GaussianSlices<'_, f64>,
    cameras: &CameraSlices<'_, f64>,
    settings: &RasterSettings,
    (v, group): (usize, usize),
) -> Vec<Seen> {
    let mut seen = see_all(gaussians, cameras, settings, v);
    seen.retain(|splat| gaussians.groups.is_none_or(|groups| groups.of[splat.index] as usize == group));
    seen
}

/// The center of a pixel of a region.
fn center(region: &Region, pixel: usize) -> (f64, f64) {
    ((region.x + pixel % region.width) as f64 + 0.5, (region.y + pixel / region.width) as f64 + 0.5)
}

/// Sums over the pixels of a view for a splat beside its gradient.
#[derive(Clone, Default)]
struct Tally {
    absolute: [f64; 2],
    weight: f64,
    largest: f64,
}

impl Tally {
    fn add_to(&self, statistics: &mut GaussianStatistics<f64>, splat: &Seen, gradient: &SeenGradient) {
        statistics.screen_gradient += gradient[0].hypot(gradient[1]);
        statistics.absgrad += self.absolute[0].hypot(self.absolute[1]);
        statistics.views += 1;
        statistics.radius = statistics.radius.max(splat.radius);
        statistics.contribution += self.weight;
        statistics.largest_weight = statistics.largest_weight.max(self.largest);
    }
}

/// Draws as [`crate::rasterize`] does.
///
/// Through a [lens](weaver_scene::Model::Lens), [`crate::rasterize`]'s formula for rays is evaluated as the quadratic
/// form of a 3x3 matrix, without a basis of the plane.
///
/// # Errors
///
/// Arguments whose lengths do not fit together.
pub fn rasterize(
    gaussians: &GaussianSlices<'_, f64>,
    cameras: &CameraSlices<'_, f64>,
    settings: &RasterSettings,
) -> Result<Rendered, RasterError> {
    let extent = Extent::through_any_lens(gaussians, cameras, settings, true)?;
    if let Model::Lens(lens) = cameras.model {
        return rays::rasterize(gaussians, cameras, lens, settings, &extent);
    }
    let mut out = Rendered::default();
    let mut features = vec![0.0; extent.channels];
    for (v, group) in pictures(&extent) {
        let seen = see_group(gaussians, cameras, settings, (v, group));
        let background = cameras.background_of(v);
        for pixel in 0..extent.region.pixels() {
            let (x, y) = center(&extent.region, pixel);
            let (touches, transmittance) = blend(&seen, settings, x, y);
            let mut color = background.map(|b| transmittance * b);
            let mut depth = 0.0;
            features.fill(0.0);
            for touch in &touches {
                let (splat, weight) = (&seen[touch.at], touch.alpha * touch.before);
                (0..3).for_each(|i| color[i] += weight * splat.color[i].value);
                depth += weight * splat.z.value;
                features.iter_mut().zip(features_of(gaussians, splat)).for_each(|(sum, x)| *sum += weight * x);
            }
            out.features.extend(&features);
            if !matches!(gaussians.color, Color::None) {
                out.image.extend(color);
            }
            out.alpha.push(1.0 - transmittance);
            out.depth.push(depth);
        }
    }
    Ok(out)
}

/// Differentiates as [`crate::rasterize_backward`] does, for pinholes.
///
/// # Errors
///
/// Cameras that are not pinholes, arguments whose lengths do not fit together.
pub fn rasterize_backward(
    gaussians: &GaussianSlices<'_, f64>,
    cameras: &CameraSlices<'_, f64>,
    settings: &RasterSettings,
    cotangents: &Cotangents<'_, f64>,
) -> Result<RenderedBackward, RasterError> {
    let extent = Extent::of(gaussians, cameras, settings, true)?;
    let (n, views, pixels) = (extent.gaussians, extent.views, extent.region.pixels());
    let mut out = RenderedBackward {
        means: vec![0.0; 3 * n],
        quats: vec![0.0; 4 * n],
        scales: vec![0.0; 3 * n],
        opacities: vec![0.0; n],
        colors: vec![0.0; extent.color_len * n],
        features: vec![0.0; extent.channels * n],
        viewmats: vec![0.0; cameras.viewmats.len()],
        intrinsics: vec![0.0; 4 * views],
        background: vec![0.0; cameras.background.len()],
        statistics: vec![GaussianStatistics::default(); n],
    };
    let shared_background = cameras.background.len() == 3;
    for (picture, (v, group)) in pictures(&extent).enumerate() {
        let seen = see_group(gaussians, cameras, settings, (v, group));
        let background = cameras.background_of(v);
        let mut gradients: Vec<SeenGradient> = vec![[0.0; 10]; seen.len()];
        let mut tallies = vec![Tally::default(); seen.len()];
        for pixel in 0..pixels {
            let at = picture * pixels + pixel;
            let dimages = cotangents.image.filter(|d| !d.is_empty());
            let dimage: [f64; 3] = std::array::from_fn(|i| dimages.map_or(0.0, |d| d[3 * at + i]));
            let dalpha = cotangents.alpha.map_or(0.0, |d| d[at]);
            let ddepth = cotangents.depth.map_or(0.0, |d| d[at]);
            let dfeature = |channel: usize| cotangents.features.map_or(0.0, |d| d[extent.channels * at + channel]);
            let (x, y) = center(&extent.region, pixel);
            let (touches, transmittance) = blend(&seen, settings, x, y);
            let mut behind = -transmittance * dalpha;
            for i in 0..3 {
                behind += transmittance * dimage[i] * background[i];
                out.background[if shared_background { i } else { 3 * v + i }] += transmittance * dimage[i];
            }
            for touch in touches.iter().rev() {
                let splat = &seen[touch.at];
                let gradient = &mut gradients[touch.at];
                let weight = touch.alpha * touch.before;
                let tally = &mut tallies[touch.at];
                tally.weight += weight;
                tally.largest = tally.largest.max(weight);
                let mut value = ddepth * splat.z.value;
                for i in 0..3 {
                    value += dimage[i] * splat.color[i].value;
                    gradient[7 + i] += weight * dimage[i];
                }
                gradient[6] += weight * ddepth;
                for (channel, feature) in features_of(gaussians, splat).iter().enumerate() {
                    value += dfeature(channel) * feature;
                    out.features[splat.index * extent.channels + channel] += weight * dfeature(channel);
                }
                let dalpha = touch.before * value - behind / (1.0 - touch.alpha);
                behind += weight * value;
                if touch.capped {
                    continue;
                }
                let (dx, dy) = (touch.dx, touch.dy);
                let [a, b, c] = splat.conic.map(|number| number.value);
                let dsigma = -touch.alpha * dalpha;
                let dcenter = [-dsigma * (a * dx + b * dy), -dsigma * (b * dx + c * dy)];
                for axis in 0..2 {
                    gradient[axis] += dcenter[axis];
                    tally.absolute[axis] += dcenter[axis].abs();
                }
                gradient[2] += 0.5 * dsigma * dx * dx;
                gradient[3] += dsigma * dx * dy;
                gradient[4] += 0.5 * dsigma * dy * dy;
                gradient[5] += dalpha * touch.alpha / splat.opacity.value;
            }
        }
        for ((splat, gradient), tally) in seen.iter().zip(&gradients).zip(&tallies) {
            if tally.weight > 0.0 {
                tally.add_to(&mut out.statistics[splat.index], splat, gradient);
            }
            out.add(splat, gradient, v, cameras.matrix_len(), extent.color_len);
        }
    }
    Ok(out)
}

impl RenderedBackward {
    /// Adds the gradient of one splat through its projection.
    fn add(&mut self, splat: &Seen, gradient: &SeenGradient, v: usize, matrix_len: usize, color_len: usize) {
        let mut total = [0.0; VARIABLES];
        for (number, weight) in splat.numbers().iter().zip(gradient) {
            // A splat that no pixel sees has no gradient, even if its derivatives are infinite.
            if *weight != 0.0 {
                (0..VARIABLES).for_each(|i| total[i] += weight * number.partial[i]);
            }
        }
        let n = splat.index;
        (0..3).for_each(|i| self.means[3 * n + i] += total[i]);
        (0..4).for_each(|i| self.quats[4 * n + i] += total[3 + i]);
        (0..3).for_each(|i| self.scales[3 * n + i] += total[7 + i]);
        self.opacities[n] += total[10];
        (0..12).for_each(|i| self.viewmats[v * matrix_len + i] += total[11 + i]);
        (0..4).for_each(|i| self.intrinsics[4 * v + i] += total[23 + i]);
        for i in 0..color_len {
            let open = if splat.open[i % 3] { 1.0 } else { 0.0 };
            self.colors[n * color_len + i] += open * splat.basis[i / 3] * gradient[7 + i % 3];
        }
    }
}
