//! A place whose Gaussians are being corrected: its photos, and the gradients that they give.

use std::sync::Arc;
use weaver_fit::strategy::Split;
use weaver_fit::{Density, FitSettings, Moment, Population, Strategy, StrategyKind};
use weaver_geometry::Camera;
use weaver_geometry::glam::DVec3;
use weaver_inference::{Photos, Prediction, Refined};
use weaver_kernels::random::Stream;
use weaver_losses::Photometric;
use weaver_scene::{CameraSlices, Color, GaussianSlices, Gaussians, Model, intrinsics_row, viewmat};
use weaver_splat::{
    Cotangents, CpuRasterizer, GaussianStatistics, Gradients, Images, RasterSettings, Rasterizer, Session, Target,
};

/// Degree up to which the population has room: columns of harmonics that are not drawn hold the state, so that density
/// control carries it along.
const ROOM: usize = 3;
/// Numbers of the state of a Gaussian.
pub const STATE: usize = 8;
/// Numbers of each kind: means, log scales, quaternions, logits, harmonics of degree 0, and of degree 1.
pub const WIDTHS: [usize; 6] = [3, 3, 4, 1, 3, 9];
/// Numbers of a Gaussian.
pub const NUMBERS: usize = 23;

/// A photo and its camera.
#[derive(Clone, Debug)]
pub struct Shot {
    pub camera: Camera,
    /// Colors `[H, W, 3]`.
    pub pixels: Vec<f32>,
}

/// The photos with their cameras, as a refinement rounds them.
pub fn shots(photos: Photos<'_>, cameras: &[Camera]) -> Vec<Shot> {
    let pixels = photos.height * photos.width;
    let of = |planes: &[f32]| -> Vec<f32> {
        let at = |i: usize| (planes[i % 3 * pixels + i / 3] * 255.0).round() * (1.0 / 255.0);
        (0..3 * pixels).map(at).collect()
    };
    (photos.planes.chunks_exact(3 * pixels).zip(cameras))
        .map(|(planes, camera)| Shot { camera: *camera, pixels: of(planes) })
        .collect()
}

/// Loss between a drawn view and its photo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Loss {
    /// L1 and SSIM, as in a fit.
    Fit(f64),
    /// The logarithm of the mean squared difference.
    LogSquare,
}

/// Draws, and finds gradients.
#[derive(Debug)]
pub struct Drawer {
    session: Box<dyn Session<f32>>,
    pub raster: RasterSettings,
    pub background: [f32; 3],
    photometric: Photometric<f32>,
    image: Vec<f32>,
    alpha: Vec<f32>,
    slope: Vec<f32>,
    scales: Vec<f32>,
    opacities: Vec<f32>,
    sh: Vec<f32>,
}

impl Drawer {
    pub fn new(raster: RasterSettings, background: [f32; 3]) -> Self {
        let session = CpuRasterizer.session();
        let photometric = Photometric::new();
        let [image, alpha, slope, scales, opacities, sh] = std::array::from_fn(|_| Vec::new());
        Self { session, raster, background, photometric, image, alpha, slope, scales, opacities, sh }
    }

    /// Gradients with respect to the stored parameters, `[N, 23]` by kinds, and the mean squared difference.
    pub fn gradients(
        &mut self,
        of: &Population,
        shot: &Shot,
        loss: Loss,
        weights: [f32; 2],
        statistics: Option<&mut [GaussianStatistics<f32>]>,
        to: &mut [Vec<f32>; 6],
    ) -> f64 {
        let n = of.len();
        let (h, w) = (shot.camera.height, shot.camera.width);
        self.scales.clear();
        self.scales.extend(of.log_scales.values.iter().map(|x| x.exp()));
        self.opacities.clear();
        self.opacities.extend(of.logits.values.iter().map(|x| 1.0 / (1.0 + (-x).exp())));
        self.sh.clear();
        self.sh.extend(of.sh.values.chunks_exact(of.sh.width()).flat_map(|row| &row[..12]));
        let gaussians = GaussianSlices {
            means: &of.means.values,
            quats: &of.quats.values,
            scales: &self.scales,
            opacities: &self.opacities,
            color: Color::Sh { coefficients: &self.sh, degree: 1 },
            features: None,
            groups: None,
        };
        let (viewmats, intrinsics) = (viewmat(&shot.camera.pose), intrinsics_row(&shot.camera));
        let cameras = CameraSlices {
            viewmats: &viewmats,
            intrinsics: &intrinsics,
            background: &self.background,
            width: w,
            height: h,
            model: Model::Pinhole,
        };
        self.image.resize(3 * h * w, 0.0);
        self.slope.resize(3 * h * w, 0.0);
        self.alpha.resize(h * w, 0.0);
        let images = Images { image: &mut self.image, alpha: &mut self.alpha, depth: None, features: None };
        self.session.forward(&gaussians, &cameras, &self.raster, images).expect("a view of this size can be drawn");
        let pairs = || self.image.iter().map(|x| x.clamp(0.0, 1.0)).zip(&shot.pixels);
        let mse = pairs().map(|(a, b)| f64::from((a - b) * (a - b))).sum::<f64>() / (3 * h * w) as f64;
        match loss {
            Loss::Fit(weight) => {
                self.photometric.value_and_gradient(&self.image, &shot.pixels, [h, w], weight, &mut self.slope);
            }
            Loss::LogSquare => {
                let factor = 2.0 / (3 * h * w) as f32 / mse.max(1e-6) as f32;
                let clamped = self.image.iter().zip(&shot.pixels);
                self.slope.iter_mut().zip(clamped).for_each(|(s, (a, b))| *s = factor * (a.clamp(0.0, 1.0) - b));
            }
        }
        let mut sh = vec![0.0; 12 * n];
        {
            let [means, scales, quats, opacities, ..] = to;
            for (values, width) in [&mut *means, scales, quats, opacities].into_iter().zip(WIDTHS) {
                values.resize(n * width, 0.0);
            }
            let targets = Gradients {
                means: Some(Target::write(means)),
                quats: Some(Target::write(quats)),
                scales: Some(Target::write(scales)),
                opacities: Some(Target::write(opacities)),
                colors: Some(Target::write(&mut sh)),
                statistics,
                ..Gradients::default()
            };
            let cotangents = Cotangents { image: Some(&self.slope), ..Cotangents::default() };
            self.session.backward(&gaussians, &cameras, &self.raster, &cotangents, targets).expect("drawn before");
            let [opacity, scale] = weights;
            scales.iter_mut().zip(&self.scales).for_each(|(g, s)| *g = (*g + scale) * s);
            opacities.iter_mut().zip(&self.opacities).for_each(|(g, o)| *g = (*g + opacity) * o * (1.0 - o));
        }
        to[4].clear();
        to[5].clear();
        for row in sh.chunks_exact(12) {
            to[4].extend(&row[..3]);
            to[5].extend(&row[3..]);
        }
        mse
    }
}

/// Gaussians on their way.
#[derive(Debug)]
pub struct Place {
    /// Photos that are corrected by.
    pub context: Vec<Shot>,
    /// Photos that judge.
    pub targets: Vec<Shot>,
    pub population: Population,
    statistics: Vec<GaussianStatistics<f32>>,
    pub settings: FitSettings,
    strategy: Box<dyn Strategy>,
    pub step: usize,
    extent: f64,
    pub per_pixel: f32,
    /// Nearest others `[N, K]`.
    pub neighbors: Arc<Vec<u32>>,
    neighbors_at: usize,
    pub gradients: [Vec<f32>; 6],
    pub mse: f64,
}

/// Nearest others that each Gaussian is shown.
pub const NEIGHBORS: usize = 8;
/// Steps between searches of them.
const SEARCHED: usize = 20;

impl Place {
    /// A prediction with its photos, to be corrected in `steps` steps, by the settings of a refinement.
    pub fn new(photos: Photos<'_>, prediction: &Prediction, targets: Vec<Shot>, steps: usize, moves: bool) -> Self {
        let mut gaussians = prediction.gaussians.to_stored();
        assert!(gaussians.degree <= 1, "harmonics of degree 1");
        gaussians.opacity_logits.iter_mut().for_each(|o| *o = o.clamp(-9.0, 9.0));
        let mut settings = Refined::usual_settings();
        settings.gaussians = gaussians.len();
        let per_pixel = gaussians.len() as f32 / prediction.counts.len().max(1) as f32;
        settings.density.opacity_weight *= per_pixel;
        settings.density.scale_weight *= per_pixel;
        settings.steps = steps;
        settings.density.rounds = settings.density.rounds.min(steps.div_ceil(10));
        if !moves {
            settings.density.strategy = StrategyKind::Keep;
        }
        let context = shots(photos, &prediction.cameras);
        let mut population = Population::new(&gaussians);
        population.raise_degree(ROOM);
        Self {
            extent: extent(&context),
            context,
            targets,
            statistics: vec![GaussianStatistics::default(); gaussians.len()],
            strategy: strategy(&settings.density),
            settings,
            population,
            step: 0,
            per_pixel,
            neighbors: Arc::default(),
            neighbors_at: 0,
            gradients: Default::default(),
            mse: 0.0,
        }
    }

    /// A copy of the place, with density control of its own.
    pub fn copied(&self) -> Self {
        Self {
            context: self.context.clone(),
            targets: self.targets.clone(),
            population: self.population.clone(),
            statistics: self.statistics.clone(),
            settings: self.settings.clone(),
            strategy: strategy(&self.settings.density),
            step: self.step,
            extent: self.extent,
            per_pixel: self.per_pixel,
            neighbors: self.neighbors.clone(),
            neighbors_at: self.neighbors_at,
            gradients: Default::default(),
            mse: self.mse,
        }
    }

    pub fn done(&self) -> bool {
        self.step >= self.settings.steps
    }

    fn moment(&self) -> Moment {
        let rates = self.settings.rates.clone();
        let fraction = self.step as f64 / self.settings.steps as f64;
        Moment {
            step: self.step,
            since: self.step,
            steps: self.settings.steps,
            budget: self.settings.gaussians,
            mean_rate: (rates.means * self.faster() * self.extent * rates.means_end.powf(fraction)) as f32,
            extent: self.extent as f32,
            stream: Stream::new(self.settings.seed, self.step as u64, "fit.density"),
        }
    }

    /// Short runs go in longer steps.
    fn faster(&self) -> f64 {
        (6000.0 / self.settings.steps as f64).max(1.0).powf(self.settings.rates.power).min(2.5)
    }

    /// Rates of the kinds now.
    pub fn rates(&self) -> [f32; 6] {
        let rates = &self.settings.rates;
        let [scales, quats, opacities, sh] =
            [rates.scales, rates.quats, rates.opacities, rates.sh].map(|rate| (rate * self.faster()) as f32);
        [self.moment().mean_rate, scales, quats, opacities, sh, sh * rates.sh_rest as f32]
    }

    /// Looks at the photo of this step, and updates the moments of the gradients.
    pub fn look(&mut self, drawer: &mut Drawer) {
        let moment = self.moment();
        let views = self.context.len();
        let mut order: Vec<usize> = (0..views).collect();
        Stream::new(self.settings.seed, (self.step / views) as u64, "fit.photos").shuffle(&mut order);
        let shot = &self.context[order[self.step % views]];
        let wanted = self.strategy.wants_statistics(&moment).then_some(&mut self.statistics[..]);
        let regularizer = self.strategy.regularizer(&moment, self.population.len());
        let weights = [regularizer.opacity, regularizer.scale];
        let loss = Loss::Fit(self.settings.ssim_weight);
        self.mse = drawer.gradients(&self.population, shot, loss, weights, wanted, &mut self.gradients);
        for (kind, width) in WIDTHS.into_iter().enumerate() {
            let gradients = &self.gradients[kind];
            let (field, from) = field(&mut self.population, kind);
            let all = field.width();
            for (n, row) in gradients.chunks_exact(width).enumerate() {
                let at = n * all + from;
                for (i, g) in row.iter().enumerate() {
                    let (m, v) = (&mut field.first[at + i], &mut field.second[at + i]);
                    *m = 0.9 * *m + (1.0 - 0.9) * g;
                    *v = 0.999 * *v + (1.0 - 0.999) * g * g;
                }
            }
        }
    }

    /// Moves the Gaussians by changes `[N, 23]`.
    pub fn apply(&mut self, changes: &[f32]) {
        let mut from = 0;
        for (kind, width) in WIDTHS.into_iter().enumerate() {
            let (field, first) = field(&mut self.population, kind);
            let all = field.width();
            for (row, change) in field.values.chunks_exact_mut(all).zip(changes.chunks_exact(NUMBERS)) {
                row[first..].iter_mut().zip(&change[from..][..width]).for_each(|(x, d)| *x -= d);
            }
            from += width;
        }
        self.step += 1;
    }

    /// True if density moves now.
    pub fn round_is_due(&self) -> bool {
        self.strategy.is_due(&self.moment())
    }

    pub fn move_density(&mut self) {
        let moment = self.moment();
        if self.strategy.adapt(&moment, &mut self.population, &self.statistics) {
            self.statistics.clear();
            self.statistics.resize(self.population.len(), GaussianStatistics::default());
        }
    }

    /// The state of all Gaussians `[N, STATE]`.
    pub fn state(&self) -> Vec<f32> {
        let all = self.population.sh.width();
        self.population.sh.values.chunks_exact(all).flat_map(|row| row[12..12 + STATE].to_vec()).collect()
    }

    pub fn set_state(&mut self, state: &[f32]) {
        let all = self.population.sh.width();
        for (row, state) in self.population.sh.values.chunks_exact_mut(all).zip(state.chunks_exact(STATE)) {
            row[12..12 + STATE].copy_from_slice(state);
        }
    }

    /// Searches the neighbors again where they are old.
    pub fn search(&mut self) {
        let n = self.population.len();
        let k = NEIGHBORS.min(n.saturating_sub(1));
        if self.neighbors.len() == n * NEIGHBORS && self.step < self.neighbors_at + SEARCHED {
            return;
        }
        let mut found = vec![0; n * (k + 1)];
        weaver_kernels::nearest_neighbors::nearest_neighbors(&self.population.means.values, k, &mut found);
        let others = |row: &[u32]| -> Vec<u32> { (0..NEIGHBORS).map(|i| row[1 + i % k.max(1)]).collect() };
        self.neighbors = Arc::new(found.chunks_exact(k + 1).flat_map(others).collect());
        self.neighbors_at = self.step;
    }

    pub fn gaussians(&self) -> Gaussians {
        let mut gaussians = self.population.to_gaussians(0);
        let all = 3 * gaussians.coefficients();
        gaussians.sh = gaussians.sh.chunks_exact(all).flat_map(|row| row[..12].to_vec()).collect();
        gaussians.degree = 1;
        gaussians
    }
}

/// The array that holds a kind, and its first column of it.
pub fn field(population: &mut Population, kind: usize) -> (&mut weaver_fit::Field, usize) {
    match kind {
        0 => (&mut population.means, 0),
        1 => (&mut population.log_scales, 0),
        2 => (&mut population.quats, 0),
        3 => (&mut population.logits, 0),
        4 => (&mut population.sh, 0),
        _ => (&mut population.sh, 3),
    }
}

fn strategy(density: &Density) -> Box<dyn Strategy> {
    match density.strategy {
        StrategyKind::Keep => Box::new(weaver_fit::strategy::Keep),
        _ => Box::new(Split::new(density.clone())),
    }
}

fn extent(shots: &[Shot]) -> f64 {
    let centers: Vec<DVec3> = shots.iter().map(|shot| shot.camera.pose.center()).collect();
    let middle = centers.iter().sum::<DVec3>() / centers.len() as f64;
    1.1 * centers.iter().map(|c| c.distance(middle)).fold(0.0, f64::max)
}
