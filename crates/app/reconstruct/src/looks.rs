//! Held-out photos, looked at while the fit goes on.

use crate::Error;
use crate::fitting::Fitting;
use crate::loaded::Loaded;
use crate::results::corrected;
use weaver_fit::Judge;
use weaver_run::Job;

/// Looks in a run, evenly spread.
const LOOKS: usize = 20;
/// Photos of a look, at most.
const PHOTOS: usize = 4;

impl Fitting {
    /// Some of the held-out photos, judged while the fit goes on. Where cameras are refined there are none, since
    /// held-out photos would have to be located in the scene first.
    fn looked_at(&self) -> Vec<usize> {
        let photos = if self.settings.fit.poses.refine { 0 } else { self.capture.held_out.len() };
        weaver_data::uniform(photos, photos.min(PHOTOS))
    }

    /// Photos that are drawn and judged for all looks of a run.
    pub fn looks(&self) -> usize {
        LOOKS * self.looked_at().len()
    }

    /// Mean PSNR of held-out photos, dB, after a step of the number `before` that is followed by a look.
    ///
    /// # Errors
    /// When the rasterizer refuses.
    pub fn look(&mut self, before: usize) -> Result<Option<f64>, Error> {
        let [done, steps] = self.steps();
        if done * LOOKS / steps == before * LOOKS / steps {
            return Ok(None);
        }
        self.glances()
    }

    /// Mean PSNR of the held-out photos that are looked at, dB; `None` where there are none.
    ///
    /// # Errors
    /// When the rasterizer refuses.
    pub fn glances(&mut self) -> Result<Option<f64>, Error> {
        let photos = self.looked_at();
        if photos.is_empty() {
            return Ok(None);
        }
        let Loaded { fit, held_out, .. } = &mut self.capture;
        let mut sum = 0.0;
        for photo in photos.iter().map(|photo| &held_out[*photo]) {
            let image = corrected(fit.render_through(photo.model(), &photo.camera)?, fit.exposure_at(&photo.camera));
            sum += Judge::psnr(&image, &photo.rgb, photo.mask.as_deref());
        }
        Ok(Some(sum / photos.len() as f64))
    }
}
