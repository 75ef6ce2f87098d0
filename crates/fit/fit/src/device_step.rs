//! Steps on the device that keeps the Gaussians.

use crate::FitError;
use crate::device_fit::{Fitted, FittedRates, PhotoLoss, PhotoStep};
use crate::fit::Fit;
use crate::photos::at_level;
use crate::population::Field;
use crate::resident::Newer;
use crate::strategy::Moment;
use crate::transients::counted;
use std::time::{Duration, Instant};
use weaver_scene::{CameraSlices, intrinsics_row, viewmat};

impl Fit {
    /// Copies the Gaussians and their statistics from the device that keeps them.
    ///
    /// A device keeps them from step to step; before [`population`](Self::population), [`gaussians`](Self::gaussians)
    /// and [`state`](Self::state) are called, they have to be fetched. With the rasterizer for CPUs there is nothing to
    /// fetch.
    ///
    /// # Errors
    /// When the device fails.
    pub fn fetch(&mut self) -> Result<(), FitError> {
        let Some(resident) = self.resident.as_mut().filter(|resident| resident.newer == Newer::Device) else {
            return Ok(());
        };
        let degree = self.population.degree();
        let [means, log_scales, quats, logits, sh] = self.population.fields_mut().map(Field::slices_mut);
        resident.device.store(Fitted { means, quats, log_scales, logits, sh, degree }, &mut self.statistics)?;
        resident.newer = Newer::Neither;
        Ok(())
    }

    /// Records that the Gaussians on the host were changed.
    pub(crate) fn changed(&mut self) {
        self.resident.iter_mut().for_each(|resident| resident.newer = Newer::Host);
    }

    /// True if the Gaussians on the host are the newest.
    pub(crate) fn is_fetched(&self) -> bool {
        self.resident.as_ref().is_none_or(|resident| resident.newer != Newer::Device)
    }

    /// True if steps are taken on the device: it has no color corrections, refines no cameras, drops no Gaussians and
    /// looks at one photo.
    pub(crate) fn is_resident(&self) -> bool {
        self.resident.is_some()
            && self.exposures.is_empty()
            && !self.settings.poses.refine
            && self.settings.dropout == 0.0
            && !self.settings.surfaces.count()
            && self.settings.views_per_step == 1
    }

    /// Time of each pass on the device since the last call; nothing where that is not measured.
    pub fn pass_times(&mut self) -> Vec<(&'static str, Duration)> {
        self.resident.as_mut().map(|resident| resident.device.pass_times()).unwrap_or_default()
    }

    /// One step toward a photo, on the device. Returns the loss, the mean squared difference and the pairs.
    pub(crate) fn step_on_device(
        &mut self,
        index: usize,
        level: usize,
        moment: &Moment,
    ) -> Result<(f64, f64, u64), FitError> {
        let start = Instant::now();
        let camera = self.camera(index);
        let (photo, level) = self.photos[index].level(level);
        let camera = at_level(&camera, level);
        let viewmats = viewmat(&camera.pose);
        let intrinsics = intrinsics_row(&camera);
        let background = &self.settings.background;
        let (width, height) = (camera.width, camera.height);
        let mask = counted(photo, self.transients[index].as_ref());
        let rates = self.settings.rates.in_run_of(self.settings.taken_at(self.step)).at(moment.fraction());
        let regularizer = self.strategy.regularizer(moment, self.population.len());
        let Some(resident) = &mut self.resident else { return Ok((f64::NAN, f64::NAN, 0)) };
        if resident.newer == Newer::Host {
            resident.load(&self.population)?;
        }
        let PhotoLoss { loss, mse, pairs } = resident.device.step(&PhotoStep {
            camera: CameraSlices {
                viewmats: &viewmats,
                intrinsics: &intrinsics,
                background,
                width,
                height,
                model: photo.model(),
            },
            settings: &self.raster,
            rgb: &photo.rgb,
            mask: mask.as_deref(),
            ssim_weight: self.settings.ssim_weight,
            regularizer: [regularizer.opacity, regularizer.scale],
            step: moment.step as u64 + 1,
            rates: FittedRates {
                means: moment.mean_rate,
                quats: rates.quats as f32,
                scales: rates.scales as f32,
                opacities: rates.opacities as f32,
                sh: rates.sh as f32,
                sh_rest: (rates.sh * rates.sh_rest) as f32,
            },
            statistics: self.strategy.wants_statistics(moment),
        })?;
        resident.newer = Newer::Device;
        if !loss.is_finite() {
            return Err(self.diverged(loss, index, moment));
        }
        self.timings.forward = start.elapsed();
        Ok((loss, mse, pairs))
    }
}
