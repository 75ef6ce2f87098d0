//! The optimization.

use crate::FitError;
use crate::comparison::Buffers;
use crate::device_fit::FitRasterizer;
use crate::exposure::Exposure;
use crate::gradients::{Activated, Gradients};
use crate::init::{first_depth, looked_at};
use crate::photos::{self, Pyramid};
use crate::population::Population;
use crate::resident::Resident;
use crate::rounding::Rounding;
use crate::settings::FitSettings;
use crate::strategy::{Moment, Strategy};
use crate::surfaces::{KnownDepth, SurfaceBuffers};
use crate::thinning::Thinning;
use crate::transients::Transients;
use std::sync::Arc;
use std::time::{Duration, Instant};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Pose};
use weaver_kernels::random::Stream;
use weaver_ranks::{Alone, Ranks};
use weaver_scene::{Gaussians, Photo};
use weaver_splat::{CpuRasterizer, GaussianStatistics, RasterSettings, Session};

/// Report of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepReport {
    /// Steps done, this one included.
    pub step: usize,
    /// The photo it looked at, or the first of several.
    pub photo: usize,
    /// The loss, the mean over several photos.
    pub loss: f64,
    /// Peak signal-to-noise ratio of the photo, dB, at the size it was seen at; for several, of their mean squared
    /// difference.
    pub psnr: f64,
    /// Gaussians after the step.
    pub gaussians: usize,
    /// Gaussians times pixels that were blended, of all photos.
    pub pairs: u64,
}

/// Times of the parts of the last step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepTimings {
    /// Drawing.
    pub forward: Duration,
    /// Loss and its gradient with respect to the image, photo and corrections included.
    pub loss: Duration,
    /// Gradients with respect to the Gaussians and the camera.
    pub backward: Duration,
    /// The optimizer's step.
    pub optimizer: Duration,
    /// Density control.
    pub density: Duration,
    /// The search for transients.
    pub search: Duration,
}

impl StepTimings {
    /// Time of periodic work, which happens as often in a short run as in a long one.
    pub(crate) fn rounds(&self) -> Duration {
        self.density + self.search
    }
}

/// A scene that is being fitted to photos.
///
/// Each step draws one photo's view, compares it with the photo, and moves Gaussians (and, if asked, camera and color
/// correction) down the gradient by Adam. Photos come in an order drawn anew for every round. Sources: Kerbl et al., 3D
/// Gaussian Splatting, 2023, section 5; schedules are with [`FitSettings`].
#[derive(Debug)]
pub struct Fit {
    pub(crate) settings: FitSettings,
    pub(crate) session: Box<dyn Session<f32>>,
    /// The copy of the Gaussians on the rasterizer's device, if it has one.
    pub(crate) resident: Option<Resident>,
    pub(crate) photos: Vec<Pyramid>,
    /// The photos in the order of this round.
    order: Vec<usize>,
    pub(crate) poses: Vec<Pose>,
    pub(crate) exposures: Vec<Exposure>,
    /// Parts of each photo that no other shows.
    pub(crate) transients: Vec<Option<Transients>>,
    /// Depth of each photo that is known beforehand.
    pub(crate) depths: Vec<Option<KnownDepth>>,
    pub(crate) population: Population,
    pub(crate) statistics: Vec<GaussianStatistics<f32>>,
    pub(crate) strategy: Box<dyn Strategy>,
    pub(crate) step: usize,
    /// The first number that `step` stands for: those before it may be left out.
    pub(crate) since: usize,
    extent: f64,
    pub(crate) raster: RasterSettings,
    pub(crate) activated: Activated,
    pub(crate) gradients: Gradients,
    pub(crate) rounding: Option<(f64, Box<dyn Rounding>)>,
    pub(crate) buffers: Buffers,
    pub(crate) surfaces: SurfaceBuffers,
    pub(crate) timings: StepTimings,
    /// The processes that share the photos of a step.
    pub(crate) ranks: Arc<dyn Ranks>,
}

impl Fit {
    /// A fit of `initial` to `photos` with the rasterizer for CPUs.
    ///
    /// # Errors
    /// See [`Fit::with`].
    pub fn new(photos: Vec<Photo>, initial: &Gaussians, settings: FitSettings) -> Result<Self, FitError> {
        let strategy = settings.density.strategy();
        Self::with(Arc::new(CpuRasterizer), strategy, photos, initial, settings)
    }

    /// A fit with this rasterizer and this way to control density.
    ///
    /// # Errors
    /// When a setting is out of range, there are no photos, photos do not fit their cameras or are masked altogether,
    /// or `initial` holds no Gaussians or more than the budget.
    pub fn with(
        rasterizer: Arc<dyn FitRasterizer>,
        strategy: Box<dyn Strategy>,
        photos: Vec<Photo>,
        initial: &Gaussians,
        settings: FitSettings,
    ) -> Result<Self, FitError> {
        settings.check()?;
        if initial.is_empty() || !initial.lengths_agree() || initial.len() > settings.gaussians {
            let expected = format!("1 to {} initial ones with fields of equal length", settings.gaussians);
            return Err(FitError::setting("gaussians", expected, initial.len()));
        }
        photos.iter().try_for_each(photos::check)?;
        if photos.iter().all(Photo::is_masked) {
            let found = if photos.is_empty() { "none" } else { "photos that are masked altogether" };
            return Err(FitError::setting("photos", "at least one with pixels that count", found));
        }
        let photos: Vec<Photo> = photos.into_iter().filter(|photo| !photo.is_masked()).collect();
        if settings.views_per_step > photos.len() {
            let expected = format!("at most the {} photos that there are", photos.len());
            return Err(FitError::setting("views_per_step", expected, settings.views_per_step));
        }
        let extent = extent(&photos);
        let population = Population::new(initial);
        let raster = RasterSettings {
            antialiased: settings.antialiased,
            near: settings.near * first_depth(&photos, &initial.means),
            ..RasterSettings::default()
        };
        Ok(Self {
            session: rasterizer.session(),
            // Adam on a device has running means alone.
            resident: rasterizer.device_fit().filter(|_| settings.rates.last == 0.0).map(Resident::new),
            poses: photos.iter().map(|photo| photo.camera.pose).collect(),
            exposures: if settings.exposure { vec![Exposure::default(); photos.len()] } else { Vec::new() },
            transients: vec![None; photos.len()],
            depths: vec![None; photos.len()],
            photos: photos.into_iter().map(|photo| Pyramid::kept(photo, settings.halvings)).collect(),
            order: Vec::new(),
            statistics: vec![GaussianStatistics::default(); population.len()],
            population,
            strategy,
            step: 0,
            since: 0,
            extent,
            raster,
            activated: Activated::default(),
            gradients: Gradients::default(),
            rounding: None,
            buffers: Buffers::default(),
            surfaces: SurfaceBuffers::default(),
            timings: StepTimings::default(),
            ranks: Arc::new(Alone),
            settings,
        })
    }

    /// Settings of the fit.
    pub fn settings(&self) -> &FitSettings {
        &self.settings
    }

    /// Changes the number of steps; all schedules follow. For a run that has not begun, such as after
    /// [`steps_in`](crate::steps_in).
    pub fn set_steps(&mut self, steps: usize) {
        self.settings.steps = steps;
    }

    /// Goes on beyond the end of the run, as in the middle of one of so many steps and at most so many Gaussians
    /// ([`FitSettings::prolonged`]): rates rise again, and density control adds Gaussians once more.
    pub fn prolong(&mut self, steps: usize, gaussians: usize) {
        self.settings = self.settings.prolonged(steps, gaussians);
    }

    /// Leaves out steps of the rest of the run, so that `kept` are taken ([`FitSettings::thinned`]), and at least one
    /// is. From now on there may be at most so many Gaussians, or as many as there are.
    pub fn leave_out(&mut self, kept: usize, gaussians: Option<usize>) {
        let gaussians = gaussians.map(|most| most.max(self.population.len()).min(self.settings.gaussians));
        self.settings.thinned.retain(|thinning| thinning.at < self.step);
        self.settings.thinned.push(Thinning { at: self.step, kept: kept.max(1), gaussians });
    }

    /// Steps done, those included that were [left out](Self::leave_out).
    pub fn steps_done(&self) -> usize {
        self.step
    }

    /// The Gaussians as they are, with the optimizer's memory.
    ///
    /// # Panics
    /// If a device has newer ones, which [`fetch`](Self::fetch) brings here.
    pub fn population(&self) -> &Population {
        assert!(self.is_fetched(), "the Gaussians are on the device and were not fetched");
        &self.population
    }

    /// The Gaussians, in the form that files hold.
    ///
    /// # Panics
    /// As [`population`](Self::population).
    pub fn gaussians(&self) -> Gaussians {
        self.population().to_gaussians(self.settings.sh_degree)
    }

    /// Number of photos.
    pub fn photos(&self) -> usize {
        self.photos.len()
    }

    /// A photo at its own size, with the camera that it began with.
    pub fn photo(&self, photo: usize) -> &Photo {
        self.photos[photo].level(0).0
    }

    /// The camera of a photo as refined so far.
    pub fn camera(&self, photo: usize) -> Camera {
        Camera { pose: self.poses[photo], ..self.photo(photo).camera }
    }

    /// The color correction of a photo, if photos have them.
    pub fn exposure(&self, photo: usize) -> Option<&Exposure> {
        self.exposures.get(photo)
    }

    /// Begins with these color corrections of photos, such as gains that [`ColorAgreement`](crate::ColorAgreement)
    /// finds. Nothing happens where colors are not corrected.
    ///
    /// # Panics
    /// Unless there are as many as photos.
    pub fn begin_exposures(&mut self, corrections: impl ExactSizeIterator<Item = Exposure>) {
        assert_eq!(corrections.len(), self.photos.len(), "a correction of each photo");
        self.exposures.iter_mut().zip(corrections).for_each(|(exposure, correction)| *exposure = correction);
    }

    /// Says what is known of the depth of a photo, for the loss of depth ([`Surfaces`](crate::Surfaces)).
    ///
    /// # Errors
    /// [`FitError::Photo`] for depth of another shape than the photo's.
    pub fn set_depth(&mut self, photo: usize, depth: KnownDepth) -> Result<(), FitError> {
        depth.check(self.photo(photo))?;
        self.depths[photo] = Some(depth);
        Ok(())
    }

    /// The size of the scene: how far the cameras are apart, world units.
    pub fn extent(&self) -> f64 {
        self.extent
    }

    /// Settings of drawing the scene.
    pub fn raster_settings(&self) -> RasterSettings {
        self.raster
    }

    /// Draws the scene by other rules than [`FitSettings`] say, such as those that the initial Gaussians were made for.
    pub fn set_raster_settings(&mut self, raster: RasterSettings) {
        self.raster = raster;
    }

    /// Draws rounded Gaussians in place of those that are optimized, from this part of the run on. Those that are not
    /// [worth](Rounding::worth) their bits are removed in the first half of that.
    pub fn set_rounding(&mut self, from: f64, rounding: Box<dyn Rounding>) {
        // A device draws the optimized Gaussians, not rounded ones.
        self.resident = None;
        self.rounding = Some((from, rounding));
    }

    /// Makes the Gaussians those that the last steps have drawn, if these were rounded; the optimizer's memory stays.
    ///
    /// # Errors
    /// [`FitError::Rounding`] for Gaussians that cannot be rounded.
    pub fn settle(&mut self) -> Result<(), FitError> {
        let fraction = self.moment().fraction();
        let step = self.step;
        if let Some((_, rounding)) = self.rounding.as_mut().filter(|(from, _)| fraction >= *from) {
            let rounded = rounding.rounded(&self.population.to_gaussians(0));
            self.population.set(rounded.map_err(|source| FitError::Rounding { step, source })?);
        }
        Ok(())
    }

    /// Times of the parts of the last step.
    pub fn timings(&self) -> StepTimings {
        self.timings
    }

    /// One step.
    ///
    /// # Errors
    /// When the rasterizer refuses, or the loss is no number any more.
    pub fn step(&mut self) -> Result<StepReport, FitError> {
        let step = self.step;
        let settings = &self.settings;
        let fraction = step as f64 / settings.steps.max(1) as f64;
        let degree = (fraction / settings.sh_interval.max(1e-9)) as usize;
        let degree = degree.min(settings.sh_degree);
        if degree > self.population.degree() {
            self.fetch()?;
            self.population.raise_degree(degree);
            self.changed();
        }
        let moment = self.moment();
        self.remove_worthless(&moment)?;
        let views = self.settings.views_per_step;
        let photo = self.photo_of(step * views);
        let level = self.settings.level(fraction);
        let (loss, mse, pairs) = if self.is_resident() {
            self.step_on_device(photo, level, &moment)?
        } else {
            let found = match views {
                1 => self.gradients_of(photo, level, &moment)?,
                _ => self.mean_gradients(level, &moment)?,
            };
            let start = Instant::now();
            self.gradients.apply(
                step as u64 + 1,
                &mut self.population,
                &self.activated,
                &self.settings.rates.in_run_of(self.settings.taken_at(self.step)).at(fraction),
                moment.mean_rate,
            );
            self.timings.optimizer = start.elapsed();
            found
        };
        (self.since, self.step) = (step + 1, self.settings.after(step));
        let rounds = |steps: usize| steps * views / self.photos.len();
        if rounds(self.step) > rounds(step) {
            self.center_exposures();
        }
        let start = Instant::now();
        self.search_transients()?;
        self.timings.search = start.elapsed();
        let start = Instant::now();
        let moment = self.moment();
        if self.strategy.is_due(&moment) {
            self.fetch()?;
            if self.strategy.adapt(&moment, &mut self.population, &self.statistics) {
                self.statistics.clear();
                self.statistics.resize(self.population.len(), GaussianStatistics::default());
            }
            self.changed();
        }
        debug_assert!(self.population.len() <= self.settings.gaussians, "a strategy beyond the budget");
        self.timings.density = start.elapsed();
        self.check_agreement()?;
        let gaussians = self.population.len();
        let psnr = -10.0 * mse.log10();
        Ok(StepReport { step: self.step, photo, loss, psnr, gaussians, pairs })
    }

    /// Moves the common part of all photos' corrections to the colors of the scene, which are then the mean photo's.
    /// The corrected images stay as they are, but for colors that are drawn as black.
    fn center_exposures(&mut self) {
        if let Some((mean, inverse)) = (!self.exposures.is_empty()).then(|| Exposure::common(&self.exposures)).flatten()
        {
            self.exposures.iter_mut().for_each(|exposure| exposure.follow(&inverse));
            self.population.map_colors(&mean.matrix);
        }
    }

    pub(crate) fn moment(&self) -> Moment {
        let FitSettings { steps, seed, ref rates, .. } = self.settings;
        let rates = rates.in_run_of(self.settings.taken_at(self.step));
        let fraction = self.step as f64 / steps.max(1) as f64;
        Moment {
            step: self.step,
            since: self.since,
            steps,
            budget: self.settings.gaussians_at(self.step),
            mean_rate: (rates.means * self.extent * rates.means_end.powf(fraction)) as f32,
            extent: self.extent as f32,
            stream: Stream::new(seed, self.step as u64, "fit.density"),
        }
    }

    /// The photo of a look: all once, in random order, then again in another.
    pub(crate) fn photo_of(&mut self, look: usize) -> usize {
        let n = self.photos.len();
        self.order.clear();
        self.order.extend(0..n);
        Stream::new(self.settings.seed, (look / n) as u64, "fit.photos").shuffle(&mut self.order);
        self.order[look % n]
    }

    /// The error of a loss that is no number.
    pub(crate) fn diverged(&self, loss: f64, photo: usize, moment: &Moment) -> FitError {
        FitError::Diverged { step: moment.step, photo: self.photo(photo).name.clone(), loss }
    }
}

/// Distance of a camera from the middle of all over the median, beyond which it may be astray, and the part of all
/// cameras that are: where more stand so far out, they were taken there.
const ASTRAY: (f64, f64) = (4.0, 0.05);

/// Largest distance of the cameras from their middle, times 1.1 as in 3DGS; where they stand together, a tenth of the
/// distance to their focus. Cameras [astray](ASTRAY) do not count: one that was placed wrongly would multiply the rate
/// of all means.
fn extent(photos: &[Photo]) -> f64 {
    let centers: Vec<DVec3> = photos.iter().map(|photo| photo.camera.pose.center()).collect();
    let middle = centers.iter().sum::<DVec3>() / centers.len() as f64;
    let mut distances: Vec<f64> = centers.iter().map(|c| c.distance(middle)).collect();
    distances.sort_unstable_by(f64::total_cmp);
    let (times, part) = ASTRAY;
    let farthest = times * distances[distances.len() / 2];
    let near = distances.partition_point(|distance| *distance <= farthest);
    let astray = (distances.len() - near) as f64 <= part * distances.len() as f64;
    let extent = 1.1 * distances[if astray { near } else { distances.len() } - 1];
    let distance = looked_at(&photos.iter().collect::<Vec<_>>()).distance(middle);
    if extent > 1e-3 * distance { extent } else { 0.1 * distance }
}
