//! Random scenes, and one call that renders and differentiates them.

use weaver_kernels::{Real, random::Stream};
use weaver_scene::{CameraSlices, Color, Features, GaussianSlices, Groups, Model};
use weaver_splat::{
    Cotangents, GaussianStatistics, Gradients, Images, RasterSettings, RasterStats, Region, Target, Workspace,
    rasterize, rasterize_backward,
};

/// Everything that is drawn.
#[derive(Clone, Debug)]
pub struct Scene<T> {
    pub means: Vec<T>,
    pub quats: Vec<T>,
    pub scales: Vec<T>,
    pub opacities: Vec<T>,
    pub colors: Vec<T>,
    pub degree: Option<usize>,
    /// True if there are no colors, and no image.
    pub colorless: bool,
    /// `[N, channels]`
    pub features: Vec<T>,
    pub channels: usize,
    /// The group of each Gaussian, and how many there are.
    pub groups: Option<(Vec<u32>, usize)>,
    pub viewmats: Vec<T>,
    pub intrinsics: Vec<T>,
    pub background: Vec<T>,
    pub width: usize,
    pub height: usize,
    pub model: Model,
    pub settings: RasterSettings,
}

/// Images of a scene, or cotangents for them.
#[derive(Clone, Debug, PartialEq)]
pub struct Planes<T> {
    pub image: Vec<T>,
    pub alpha: Vec<T>,
    pub depth: Vec<T>,
    pub features: Vec<T>,
}

/// Names of the gradients, in the order of [`gradients`].
pub const NAMES: [&str; 10] = [
    "means",
    "quats",
    "scales",
    "opacities",
    "colors",
    "viewmats",
    "intrinsics",
    "background",
    "features",
    "statistics",
];

impl Scene<f64> {
    /// `n` Gaussians around the view of `views` cameras: some behind, some out of sight, some opaque; cameras are not
    /// quite rigid, principal points are off center, quaternions not normalized.
    pub fn random(seed: u64, n: usize, views: usize, (width, height): (usize, usize), degree: Option<usize>) -> Self {
        let stream = Stream::new(seed, 0, "splat.test");
        let normal = |purpose: u64, i: usize| stream.fork(purpose).normal::<f64>(i as u64);
        let uniform = |purpose: u64, i: usize| stream.fork(purpose).uniform::<f64>(i as u64);
        let focal = 0.9 * width.max(height) as f64;
        let color_len = degree.map_or(3, |d| 3 * (d + 1) * (d + 1));
        let mut scene = Self {
            means: Vec::new(),
            quats: (0..4 * n).map(|i| normal(0, i)).collect(),
            scales: (0..3 * n).map(|i| 0.25 * (0.7 * normal(1, i)).exp()).collect(),
            opacities: (0..n).map(|i| 1.0 / (1.0 + (-1.5 * normal(2, i)).exp())).collect(),
            colors: (0..color_len * n).map(|i| 0.5 * normal(3, i)).collect(),
            degree,
            colorless: false,
            features: (0..2 * n).map(|i| normal(11, i)).collect(),
            channels: 2,
            groups: None,
            viewmats: Vec::new(),
            intrinsics: Vec::new(),
            background: (0..3 * views).map(|i| uniform(4, i)).collect(),
            width,
            height,
            model: Model::Pinhole,
            settings: RasterSettings::default(),
        };
        for i in 0..n {
            let z = if uniform(5, i) < 0.05 { -1.0 } else { 1.0 + 4.0 * uniform(6, i) };
            scene.means.extend([0.7 * normal(7, i) * z, 0.7 * normal(8, i) * z, z]);
        }
        for v in 0..views {
            for i in 0..3 {
                for j in 0..4 {
                    let identity = if i == j { 1.0 } else { 0.0 };
                    scene.viewmats.push(identity + 0.08 * normal(9, 12 * v + 4 * i + j));
                }
            }
            let jitter = |i: usize| 1.0 + 0.1 * normal(10, 4 * v + i);
            scene.intrinsics.extend([focal * jitter(0), focal * jitter(1)]);
            scene.intrinsics.extend([width as f64 / 2.0 * jitter(2), height as f64 / 2.0 * jitter(3)]);
        }
        scene
    }

    /// A few splats, each over the whole of a small image with alphas between the thresholds: smooth everywhere.
    pub fn smooth(seed: u64, n: usize, views: usize, size: (usize, usize), degree: Option<usize>) -> Self {
        let mut scene = Self::random(seed, n, views, size, degree);
        for i in 0..n {
            // All in front and near the axis, but not at equal depths.
            let z = 2.0 + i as f64;
            for axis in 0..2 {
                scene.means[3 * i + axis] = scene.means[3 * i + axis].clamp(-3.0, 3.0) * 0.1 * z;
            }
            scene.means[3 * i + 2] = z;
            scene.opacities[i] = 0.2 + 0.6 * scene.opacities[i];
        }
        scene.scales.iter_mut().for_each(|s| *s = s.clamp(0.1, 2.0) + 2.0);
        scene
    }

    /// With so many features.
    pub fn with_channels(mut self, channels: usize) -> Self {
        let stream = Stream::new(self.means.len() as u64, 2, "splat.test");
        self.channels = channels;
        self.features = (0..(channels * self.opacities.len()) as u64).map(|i| stream.normal(i)).collect();
        self
    }

    /// Without colors.
    pub fn without_colors(mut self) -> Self {
        (self.degree, self.colorless) = (None, true);
        self.colors.clear();
        self
    }

    /// Random cotangents.
    pub fn cotangents(&self, seed: u64) -> Planes<f64> {
        let stream = Stream::new(seed, 1, "splat.test");
        let pixels = self.pixels();
        let draw = |purpose: u64, n: usize| (0..n as u64).map(|i| stream.fork(purpose).normal(i)).collect();
        Planes {
            image: draw(0, self.image_channels() * pixels),
            alpha: draw(1, pixels),
            depth: draw(2, pixels),
            features: draw(3, self.channels * pixels),
        }
    }

    /// The arrays that have gradients, in the order of [`NAMES`].
    pub fn parts(&mut self) -> [&mut Vec<f64>; 9] {
        [
            &mut self.means,
            &mut self.quats,
            &mut self.scales,
            &mut self.opacities,
            &mut self.colors,
            &mut self.viewmats,
            &mut self.intrinsics,
            &mut self.background,
            &mut self.features,
        ]
    }

    /// The same in `f32`.
    pub fn to_f32(&self) -> Scene<f32> {
        let round = |values: &[f64]| values.iter().map(|&x| x as f32).collect();
        Scene {
            means: round(&self.means),
            quats: round(&self.quats),
            scales: round(&self.scales),
            opacities: round(&self.opacities),
            colors: round(&self.colors),
            degree: self.degree,
            colorless: self.colorless,
            features: round(&self.features),
            channels: self.channels,
            groups: self.groups.clone(),
            viewmats: round(&self.viewmats),
            intrinsics: round(&self.intrinsics),
            background: round(&self.background),
            width: self.width,
            height: self.height,
            model: self.model,
            settings: self.settings,
        }
    }
}

impl<T: Real> Scene<T> {
    /// In so many groups, not all of the same size.
    pub fn in_groups(mut self, count: usize) -> Self {
        let stream = Stream::new(self.means.len() as u64, 3, "splat.test");
        let of = (0..self.opacities.len() as u64).map(|i| stream.below(i, count).min(stream.below(!i, count)) as u32);
        self.groups = Some((of.collect(), count));
        self
    }

    pub fn views(&self) -> usize {
        self.intrinsics.len() / 4
    }

    /// Region of each view that is drawn.
    pub fn region(&self) -> Region {
        self.settings.region.unwrap_or(Region::whole(self.width, self.height))
    }

    pub fn pixels(&self) -> usize {
        self.views() * self.groups.as_ref().map_or(1, |(_, count)| *count) * self.region().pixels()
    }

    pub fn image_channels(&self) -> usize {
        if self.colorless { 0 } else { 3 }
    }

    pub fn gaussians(&self) -> GaussianSlices<'_, T> {
        GaussianSlices {
            means: &self.means,
            quats: &self.quats,
            scales: &self.scales,
            opacities: &self.opacities,
            color: match self.degree {
                None if self.colorless => Color::None,
                None => Color::Plain(&self.colors),
                Some(degree) => Color::Sh { coefficients: &self.colors, degree },
            },
            features: (self.channels > 0).then_some(Features { values: &self.features, channels: self.channels }),
            groups: self.groups.as_ref().map(|(of, count)| Groups { of, count: *count }),
        }
    }

    pub fn cameras(&self) -> CameraSlices<'_, T> {
        CameraSlices {
            viewmats: &self.viewmats,
            intrinsics: &self.intrinsics,
            background: &self.background,
            width: self.width,
            height: self.height,
            model: self.model,
        }
    }

    /// Renders with a given workspace.
    pub fn render_in(&self, workspace: &mut Workspace<T>) -> (Planes<T>, RasterStats) {
        let pixels = self.pixels();
        let nan = T::from_f64(f64::NAN);
        let channels = [self.image_channels(), 1, 1, self.channels];
        let [image, alpha, depth, features] = channels.map(|channels| vec![nan; channels * pixels]);
        let mut out = Planes { image, alpha, depth, features };
        let images = Images {
            image: &mut out.image,
            alpha: &mut out.alpha,
            depth: Some(&mut out.depth),
            features: Some(&mut out.features),
        };
        let stats = rasterize(&self.gaussians(), &self.cameras(), &self.settings, workspace, images).unwrap();
        (out, stats)
    }

    pub fn render(&self) -> Planes<T> {
        self.render_in(&mut Workspace::new()).0
    }

    /// All gradients, in the order of [`NAMES`].
    pub fn gradients(&self, cotangents: &Planes<T>) -> [Vec<T>; 10] {
        let mut workspace = Workspace::new();
        self.render_in(&mut workspace);
        self.gradients_in(cotangents, &mut workspace)
    }

    /// The same after a rendering with this workspace.
    pub fn gradients_in(&self, cotangents: &Planes<T>, workspace: &mut Workspace<T>) -> [Vec<T>; 10] {
        let n = self.opacities.len();
        let lengths = [
            3 * n,
            4 * n,
            3 * n,
            n,
            self.colors.len(),
            self.viewmats.len(),
            self.intrinsics.len(),
            self.background.len(),
            self.features.len(),
            0,
        ];
        let mut statistics = vec![GaussianStatistics::default(); n];
        let mut out = lengths.map(|len| vec![T::from_f64(f64::NAN); len]);
        let [means, quats, scales, opacities, colors, viewmats, intrinsics, background, features, _] =
            out.each_mut().map(|values| Some(Target::write(&mut values[..])));
        rasterize_backward(
            &self.gaussians(),
            &self.cameras(),
            &self.settings,
            workspace,
            &cotangents.as_cotangents(),
            Gradients {
                means,
                quats,
                scales,
                opacities,
                colors,
                features,
                viewmats,
                intrinsics: intrinsics.filter(|_| self.model == Model::Pinhole),
                background,
                statistics: Some(&mut statistics),
            },
        )
        .unwrap();
        out[9] = flatten(&statistics);
        out
    }
}

impl<T: Real> Planes<T> {
    pub fn as_cotangents(&self) -> Cotangents<'_, T> {
        Cotangents {
            image: Some(&self.image),
            alpha: Some(&self.alpha),
            depth: Some(&self.depth),
            features: Some(&self.features),
        }
    }

    /// The same in `f32`.
    pub fn to_f32(&self) -> Planes<f32> {
        let round = |values: &[T]| values.iter().map(|x| x.to_f32()).collect();
        Planes {
            image: round(&self.image),
            alpha: round(&self.alpha),
            depth: round(&self.depth),
            features: round(&self.features),
        }
    }

    /// Everything in a row.
    pub fn flat(&self) -> Vec<f64> {
        [&self.image, &self.alpha, &self.depth, &self.features].into_iter().flatten().map(|x| x.to_f64()).collect()
    }
}

/// Statistics in a row, `[N, 6]`.
pub fn flatten<T: Real>(statistics: &[GaussianStatistics<T>]) -> Vec<T> {
    let row = |s: &GaussianStatistics<T>| {
        [s.screen_gradient, s.absgrad, T::from_usize(s.views as usize), s.radius, s.contribution, s.largest_weight]
    };
    statistics.iter().flat_map(row).collect()
}

/// |a - b| / max(|b|, floor), Euclidean norms; an infinite number where something is not finite.
pub fn relative<T: Real>(a: &[T], b: &[f64], floor: f64) -> f64 {
    assert_eq!(a.len(), b.len());
    let mut difference = 0.0;
    let mut norm = 0.0;
    for (a, b) in a.iter().zip(b) {
        difference += (a.to_f64() - b).powi(2);
        norm += b * b;
    }
    if difference.is_finite() { difference.sqrt() / norm.sqrt().max(floor) } else { f64::INFINITY }
}
