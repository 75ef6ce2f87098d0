//! Going on beyond the end of a run.

use crate::fitting::Fitting;
use crate::gaining::{BEFORE, End, Gaining};
use crate::results::corrected;
use crate::{Error, Run};
use weaver_fit::Judge;
use weaver_io::Observe;
use weaver_io::safetensors::Tensors;
use weaver_run::{Folder, Job};

/// Steps of a longer run over the steps so far.
const LONGER: usize = 2;
/// Gaussians there may be, over the number so far.
const MORE: usize = 2;
/// Part of the free memory that the Gaussians may take.
const MEMORY: f64 = 0.5;

impl Run {
    /// Lets a run that came to its end go on to twice its steps, where it is to go on for as long as held-out photos
    /// gain, and they did. Where they lost, the scene is again as it was before. Returns whether it goes on.
    ///
    /// # Errors
    /// When the rasterizer refuses, or a file cannot be written or read.
    pub(crate) fn go_on(&mut self, observe: &mut dyn Observe) -> Result<bool, Error> {
        let weaver_run::Run { folder, job } = &mut self.0;
        let steps = job.settings.fit.steps;
        // An end that was judged before is the last one: else there would be more steps.
        let judged = |gaining: &Gaining| gaining.ends.iter().any(|end| end.steps == steps);
        if job.settings.gaining.as_ref().is_none_or(judged) || job.capture.held_out.is_empty() {
            return Ok(false);
        }
        let end = End { steps, gaussians: job.settings.fit.gaussians, psnr: job.held_out_psnr()? };
        let count = job.fit().population().len();
        let next = LONGER * steps;
        let Some(gaining) = &mut job.settings.gaining else { return Ok(false) };
        gaining.ends.push(end);
        let (gain, worth) = (gaining.gain(), gaining.worth);
        let met = format!("{:.2} dB held out after {} steps with {count} Gaussians", end.psnr, steps);
        if gain >= worth {
            let gained = if gain.is_finite() { format!(", {gain:+.2}") } else { String::new() };
            folder.keep_checkpoint(BEFORE)?;
            let gaussians = job.more_gaussians();
            job.prolong(next, gaussians);
            job.store(folder)?;
            observe.note(&format!("{met}{gained}: goes on to {next} steps with up to {gaussians} Gaussians"));
            return Ok(true);
        }
        observe.note(&format!("{met}, {gain:+.2}: more steps are no longer worth it"));
        if gain < 0.0 {
            job.go_back(folder)?;
        }
        job.store(folder)?;
        folder.out().remove(BEFORE)?;
        Ok(false)
    }
}

impl Fitting {
    /// Mean PSNR of the held-out photos, with the cameras as given.
    fn held_out_psnr(&mut self) -> Result<f64, Error> {
        self.capture.fit.fetch()?;
        let (fit, held_out) = (&mut self.capture.fit, &self.capture.held_out);
        let mut sum = 0.0;
        for photo in held_out {
            let image = corrected(fit.render_through(photo.model(), &photo.camera)?, fit.exposure_at(&photo.camera));
            sum += Judge::psnr(&image, &photo.rgb, photo.mask.as_deref());
        }
        Ok(sum / held_out.len() as f64)
    }

    /// The most Gaussians of a run that goes on: twice as many as now, as far as memory and the request allow.
    fn more_gaussians(&self) -> usize {
        let now = self.settings.fit.gaussians;
        let asked = self.settings.gaining.as_ref().and_then(|gaining| gaining.most_gaussians).unwrap_or(usize::MAX);
        let of_one = crate::plan::bytes_of_gaussian(self.settings.fit.sh_degree);
        let free = weaver_io::available_memory().map_or(u64::MAX, |free| (MEMORY * free as f64) as u64);
        (MORE * now).min(now + (free / of_one) as usize).min(asked.max(now))
    }

    /// Lets the run end after so many steps, with at most so many Gaussians.
    fn prolong(&mut self, steps: usize, gaussians: usize) {
        self.capture.fit.prolong(steps, gaussians);
        self.settings.fit = self.capture.fit.settings().clone();
    }

    /// Takes the scene back to the end before the last.
    fn go_back(&mut self, folder: &Folder) -> Result<(), Error> {
        let Some([.., before, _]) = self.settings.gaining.as_ref().map(|gaining| gaining.ends.as_slice()) else {
            return Ok(());
        };
        let End { steps, gaussians, .. } = *before;
        self.prolong(steps, gaussians);
        let state = Tensors::read(folder.path().join(BEFORE))?;
        self.restore(&state)?;
        Ok(folder.save(&state)?)
    }
}
