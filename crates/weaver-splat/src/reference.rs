//! The rasterizer again, slowly and in another way, to test against: every Gaussian at every pixel, in `f64`, from
//! the textbook's formulas, with the derivatives of projection by forward-mode dual numbers. No tiles, no bounds, no
//! threads.

use crate::gradients::Cotangents;
use crate::scene::{ALPHA_MIN, RATIO_FLOOR, RasterError, RasterSettings, TRANSMITTANCE_END, extent};
use weaver_autograd::Dual;
use weaver_geometry::sh;
use weaver_scene::{CameraSlices, Color, GaussianSlices};

/// Variables of a projection: mean 3, quaternion 4, scale 3, opacity 1, view matrix 12, intrinsics 4.
const VARIABLES: usize = 27;
type Number = Dual<f64, VARIABLES>;

/// One Gaussian's numbers.
struct Gaussian<'a> {
    mean: [f64; 3],
    quat: [f64; 4],
    scale: [f64; 3],
    opacity: f64,
    color: &'a [f64],
}

impl<'a> Gaussian<'a> {
    fn of(gaussians: &GaussianSlices<'a, f64>, n: usize) -> Self {
        let (values, len) = gaussians.color.values();
        Self {
            mean: std::array::from_fn(|i| gaussians.means[3 * n + i]),
            quat: std::array::from_fn(|i| gaussians.quats[4 * n + i]),
            scale: std::array::from_fn(|i| gaussians.scales[3 * n + i]),
            opacity: gaussians.opacities[n],
            color: &values[n * len..(n + 1) * len],
        }
    }
}

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
    /// `[V, N, 2]`
    pub center_pull: Vec<f64>,
}

/// What a pixel looks at, with derivatives: center x y, inverse covariance a b c, opacity, z, color.
struct Seen {
    index: usize,
    center: [Number; 2],
    conic: [Number; 3],
    opacity: Number,
    z: Number,
    color: [Number; 3],
    /// Basis functions and which channels are not clamped, for the gradient of the coefficients.
    basis: [f64; sh::MAX_COEFFICIENTS],
    open: [bool; 3],
}

/// The gradient with respect to a [`Seen`]'s ten numbers, in its order.
type SeenGradient = [f64; 10];

fn maximum(a: Number, b: Number) -> Number {
    if a.value > b.value { a } else { b }
}

fn minimum(a: Number, b: Number) -> Number {
    if a.value < b.value { a } else { b }
}

fn matmul<const A: usize, const B: usize, const C: usize>(
    a: &[[Number; B]; A],
    b: &[[Number; C]; B],
) -> [[Number; C]; A] {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| (0..B).fold(Number::constant(0.0), |sum, k| sum + a[i][k] * b[k][j]))
    })
}

fn transpose<const A: usize, const B: usize>(a: &[[Number; B]; A]) -> [[Number; A]; B] {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

/// Projects one Gaussian by the book; `None` where it is not drawn.
fn see(
    index: usize,
    gaussian: &Gaussian<'_>,
    color: &Color<'_, f64>,
    matrix: &[f64],
    k: &[f64],
    (width, height): (f64, f64),
    settings: &RasterSettings,
) -> Option<Seen> {
    let c = Number::constant;
    let (one, two) = (c(1.0), c(2.0));
    let mut values = [0.0; VARIABLES];
    values[..3].copy_from_slice(&gaussian.mean);
    values[3..7].copy_from_slice(&gaussian.quat);
    values[7..10].copy_from_slice(&gaussian.scale);
    values[10] = gaussian.opacity;
    values[11..23].copy_from_slice(&matrix[..12]);
    values[23..].copy_from_slice(&k[..4]);
    let inputs = Number::inputs(values);
    let mean: [Number; 3] = std::array::from_fn(|i| inputs[i]);
    let quat: [Number; 4] = std::array::from_fn(|i| inputs[3 + i]);
    let scale: [Number; 3] = std::array::from_fn(|i| inputs[7 + i]);
    let opacity = inputs[10];
    let axes: [[Number; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| inputs[11 + 4 * i + j]));
    let shift: [Number; 3] = std::array::from_fn(|i| inputs[11 + 4 * i + 3]);
    let [fx, fy, cx, cy]: [Number; 4] = std::array::from_fn(|i| inputs[23 + i]);

    let point = matmul(&axes, &mean.map(|m| [m]));
    let [x, y, z]: [Number; 3] = std::array::from_fn(|i| point[i][0] + shift[i]);
    if !(settings.near <= z.value && z.value <= settings.far) {
        return None;
    }

    // World covariance R diag(s^2) R^T.
    let length = quat.iter().fold(c(0.0), |sum, &q| sum + q * q).sqrt();
    let [qw, qx, qy, qz] = quat.map(|q| q / length);
    let rotation = [
        [one - two * (qy * qy + qz * qz), two * (qx * qy - qw * qz), two * (qx * qz + qw * qy)],
        [two * (qx * qy + qw * qz), one - two * (qx * qx + qz * qz), two * (qy * qz - qw * qx)],
        [two * (qx * qz - qw * qy), two * (qy * qz + qw * qx), one - two * (qx * qx + qy * qy)],
    ];
    let stretched = rotation.map(|row| [row[0] * scale[0], row[1] * scale[1], row[2] * scale[2]]);
    let covariance = matmul(&stretched, &transpose(&stretched));

    // Image covariance J A C A^T J^T.
    let (w, h, spare) = (c(width), c(height), c(0.3));
    let spare_x = spare * (w / (two * fx));
    let spare_y = spare * (h / (two * fy));
    let slope_x = minimum(maximum(x / z, -(cx / fx + spare_x)), (w - cx) / fx + spare_x);
    let slope_y = minimum(maximum(y / z, -(cy / fy + spare_y)), (h - cy) / fy + spare_y);
    let jacobian = [[fx / z, c(0.0), -(fx * slope_x / z)], [c(0.0), fy / z, -(fy * slope_y / z)]];
    let map = matmul(&jacobian, &axes);
    let sharp = matmul(&matmul(&map, &covariance), &transpose(&map));
    let eps = c(settings.eps2d);
    let (xx, xy, yy) = (sharp[0][0] + eps, sharp[0][1], sharp[1][1] + eps);
    let determinant = xx * yy - xy * xy;
    if determinant.value <= 0.0 {
        return None;
    }
    let trace = xx.value + yy.value;
    let longest = (0.5 * (trace + (trace * trace - 4.0 * determinant.value).max(0.0).sqrt())).sqrt();
    if settings.radius_clip > 0.0 && 3.0 * longest < settings.radius_clip {
        return None;
    }
    let opacity = if settings.antialiased {
        let ratio = (sharp[0][0] * sharp[1][1] - sharp[0][1] * sharp[1][0]) / determinant;
        opacity * maximum(ratio, c(RATIO_FLOOR)).sqrt()
    } else {
        opacity
    };

    let mut basis = [0.0; sh::MAX_COEFFICIENTS];
    basis[0] = 1.0;
    let mut open = [true; 3];
    let color = match *color {
        Color::None => [c(0.0); 3],
        Color::Plain(_) => std::array::from_fn(|i| c(gaussian.color[i])),
        Color::Sh { degree, .. } => {
            let adjugate: [[Number; 3]; 3] = std::array::from_fn(|i| {
                std::array::from_fn(|j| {
                    let (a, b, d, e) = ((j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3);
                    axes[a][d] * axes[b][e] - axes[a][e] * axes[b][d]
                })
            });
            let det = axes[0][0] * adjugate[0][0] + axes[0][1] * adjugate[1][0] + axes[0][2] * adjugate[2][0];
            let center = matmul(&adjugate, &shift.map(|s| [-s / det]));
            let sight: [Number; 3] = std::array::from_fn(|i| mean[i] - center[i][0]);
            let distance = sight.iter().fold(c(0.0), |sum, &s| sum + s * s).sqrt();
            let values =
                if degree == 0 { sh::basis(0, sight, c) } else { sh::basis(degree, sight.map(|s| s / distance), c) };
            basis = values.map(|b| b.value);
            let sums: [Number; 3] = std::array::from_fn(|channel| {
                (0..gaussian.color.len() / 3)
                    .fold(c(0.5), |sum, term| sum + values[term] * c(gaussian.color[3 * term + channel]))
            });
            open = sums.map(|sum| sum.value > 0.0);
            sums.map(|sum| maximum(sum, c(0.0)))
        }
    };
    let seen = Seen {
        index,
        center: [fx * x / z + cx, fy * y / z + cy],
        conic: [yy / determinant, -(xy / determinant), xx / determinant],
        opacity,
        z,
        color,
        basis,
        open,
    };
    let inputs = [&gaussian.mean[..], &gaussian.quat, &gaussian.scale, &[gaussian.opacity], gaussian.color];
    let finite = inputs.iter().all(|part| part.iter().all(|x| x.is_finite()))
        && seen.numbers().iter().all(|number| number.value.is_finite());
    finite.then_some(seen)
}

impl Seen {
    fn numbers(&self) -> [Number; 10] {
        let ([x, y], [a, b, c], [r, g, blue]) = (self.center, self.conic, self.color);
        [x, y, a, b, c, self.opacity, self.z, r, g, blue]
    }
}

/// All that view `v` sees, in drawing order.
fn see_all(
    gaussians: &GaussianSlices<'_, f64>,
    cameras: &CameraSlices<'_, f64>,
    settings: &RasterSettings,
    v: usize,
) -> Vec<Seen> {
    let matrix = &cameras.viewmats[v * cameras.matrix_len()..];
    let k = &cameras.intrinsics[4 * v..];
    let size = (cameras.width as f64, cameras.height as f64);
    let mut seen: Vec<Seen> = (0..gaussians.opacities.len())
        .filter_map(|n| see(n, &Gaussian::of(gaussians, n), &gaussians.color, matrix, k, size, settings))
        .filter(|seen| features_of(gaussians, seen).iter().all(|x| x.is_finite()))
        .collect();
    seen.sort_by(|a, b| (a.z.value as f32).total_cmp(&(b.z.value as f32)));
    seen
}

/// One splat at one pixel.
struct Touch {
    /// Which of the sorted ones.
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

/// The features of what a pixel looks at.
fn features_of<'a>(gaussians: &GaussianSlices<'a, f64>, seen: &Seen) -> &'a [f64] {
    gaussians.features.map_or(&[], |features| features.of(seen.index))
}

/// Draws as [`crate::rasterize`] does.
///
/// # Errors
///
/// Arguments whose lengths do not fit together.
pub fn rasterize(
    gaussians: &GaussianSlices<'_, f64>,
    cameras: &CameraSlices<'_, f64>,
    settings: &RasterSettings,
) -> Result<Rendered, RasterError> {
    let extent = extent(gaussians, cameras, settings, true)?;
    let mut out = Rendered::default();
    let mut features = vec![0.0; extent.channels];
    for v in 0..extent.views {
        let seen = see_all(gaussians, cameras, settings, v);
        let background = cameras.background_of(v);
        for pixel in 0..extent.width * extent.height {
            let (x, y) = ((pixel % extent.width) as f64 + 0.5, (pixel / extent.width) as f64 + 0.5);
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

/// Differentiates as [`crate::rasterize_backward`] does.
///
/// # Errors
///
/// Arguments whose lengths do not fit together.
pub fn rasterize_backward(
    gaussians: &GaussianSlices<'_, f64>,
    cameras: &CameraSlices<'_, f64>,
    settings: &RasterSettings,
    cotangents: &Cotangents<'_, f64>,
) -> Result<RenderedBackward, RasterError> {
    let extent = extent(gaussians, cameras, settings, true)?;
    let (n, views, pixels) = (extent.gaussians, extent.views, extent.width * extent.height);
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
        center_pull: vec![0.0; 2 * views * n],
    };
    let shared_background = cameras.background.len() == 3;
    for v in 0..views {
        let seen = see_all(gaussians, cameras, settings, v);
        let background = cameras.background_of(v);
        let mut gradients: Vec<SeenGradient> = vec![[0.0; 10]; seen.len()];
        for pixel in 0..pixels {
            let at = v * pixels + pixel;
            let dimages = cotangents.image.filter(|d| !d.is_empty());
            let dimage: [f64; 3] = std::array::from_fn(|i| dimages.map_or(0.0, |d| d[3 * at + i]));
            let dalpha = cotangents.alpha.map_or(0.0, |d| d[at]);
            let ddepth = cotangents.depth.map_or(0.0, |d| d[at]);
            let dfeature = |channel: usize| cotangents.features.map_or(0.0, |d| d[extent.channels * at + channel]);
            let (x, y) = ((pixel % extent.width) as f64 + 0.5, (pixel / extent.width) as f64 + 0.5);
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
                    out.center_pull[2 * (v * n + splat.index) + axis] += dcenter[axis].abs();
                }
                gradient[2] += 0.5 * dsigma * dx * dx;
                gradient[3] += dsigma * dx * dy;
                gradient[4] += 0.5 * dsigma * dy * dy;
                gradient[5] += dalpha * touch.alpha / splat.opacity.value;
            }
        }
        for (splat, gradient) in seen.iter().zip(&gradients) {
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
            // A splat that no pixel sees has no gradient, whatever its derivatives are.
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
