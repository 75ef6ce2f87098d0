//! The optimization of a capture, as a job in steps.

use crate::budget::most_gaussians;
use crate::keeping::Keeping;
use crate::loaded::{Loaded, load};
use crate::outcome::Cleaning;
use crate::{Error, RunFile, RunSettings};
use serde_json::json;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;
use weaver_fit::{CleaningRules, Fit, FitRasterizer, Judge};
use weaver_io::safetensors::Tensors;
use weaver_ranks::{Alone, Ranks, agreed_text};
use weaver_run::{Folder, Job, Log, Rhythm, Save, Scalar, StepReport};

/// A capture and the Gaussians that are fitted to it.
#[derive(Debug)]
pub(crate) struct Fitting {
    pub settings: RunSettings,
    pub capture: Loaded,
    pub judge: Judge,
    /// The processes that share the steps.
    pub ranks: Arc<dyn Ranks>,
    /// The pace, where the run is to end in its time. A resumed run leaves out the steps written down before, and no
    /// more.
    pub keeping: Option<Keeping>,
    /// Gaussians that were removed at the end.
    pub cleaning: Option<Cleaning>,
    /// Seconds of earlier sessions.
    before: f64,
    started: Instant,
}

/// The Gaussians that a run began with.
pub(crate) const INIT: &str = "init.ply";
/// Records in the log of a run of any length.
const RECORDS: usize = 500;
/// Name in the log of the mean PSNR of held-out photos, dB.
pub(crate) const HELD_OUT: &str = "held_out";
/// Where a checkpoint has the seconds that were spent before it.
const SECONDS: &str = "seconds";
/// Where a checkpoint has the Gaussians that were removed at the end.
const CLEANING: &str = "cleaning";

/// Next action of the processes that share a run, chosen by the first one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Next {
    /// Nothing more.
    End,
    /// A step.
    Step,
    /// [Leaves out](Fit::leave_out) steps.
    LeaveOut(usize),
}

impl Next {
    fn number(self) -> u64 {
        match self {
            Self::End => 0,
            Self::Step => 1,
            Self::LeaveOut(kept) => 1 + kept.max(1) as u64,
        }
    }

    /// The action for a number that processes have agreed about.
    pub fn of(number: u64) -> Self {
        match number {
            0 => Self::End,
            1 => Self::Step,
            more => Self::LeaveOut(more as usize - 1),
        }
    }
}

impl Fitting {
    pub fn new(settings: RunSettings, capture: Loaded, judge: Judge, started: Instant) -> Self {
        Self { settings, capture, judge, ranks: Arc::new(Alone), keeping: None, cleaning: None, before: 0.0, started }
    }

    /// The job of the run in a folder, with the settings of `file`, at its beginning.
    pub fn stored(
        file: RunFile,
        folder: &Path,
        judge: Judge,
        rasterizer: Arc<dyn FitRasterizer>,
    ) -> Result<Self, Error> {
        let started = Instant::now();
        let RunFile { mut settings, sources, coverage } = file;
        let given = folder.join(INIT);
        let given = given.exists().then(|| weaver_io::read_gaussians(&given)).transpose()?;
        let mut capture = load(&mut settings, given.as_ref(), rasterizer, Some(folder))?;
        capture.coverage = coverage;
        capture.sources.check(&sources, &settings.capture, &folder.join(RunFile::NAME))?;
        Ok(Self::new(settings, capture, judge, started))
    }

    /// Writes settings, input checksums and coverage.
    pub fn store(&self, folder: &Folder) -> Result<(), Error> {
        let Loaded { sources, coverage, .. } = &self.capture;
        let file = RunFile { settings: self.settings.clone(), sources: sources.clone(), coverage: coverage.clone() };
        Ok(folder.store_text(&file.text(folder.path())?)?)
    }

    /// Lets the other processes read the run in its folder, and shares the steps with them.
    pub fn share(&mut self, ranks: Arc<dyn Ranks>, folder: &Folder) -> Result<(), Error> {
        let path = std::path::absolute(folder.path()).unwrap_or(folder.path().into());
        agreed_text(&*ranks, &path.to_string_lossy());
        self.capture.fit.share(ranks.clone())?;
        self.ranks = ranks;
        Ok(())
    }

    /// Announces the next action to the other processes.
    pub fn announce(&self, next: Next) {
        self.ranks.agreed(next.number());
    }

    /// Leaves out steps where the run would not end in its time.
    fn keep_pace(&mut self, folder: &Folder) -> Result<(), Error> {
        let now = self.seconds();
        let Some(keeping) = &mut self.keeping else { return Ok(()) };
        let fit = &self.capture.fit;
        if let Some(kept) = keeping.kept(fit.settings(), fit.steps_done(), now) {
            self.leave_out(kept);
            // A run resumed from an earlier checkpoint leaves out the same.
            self.store(folder)?;
        }
        Ok(())
    }

    /// Takes only so many of the steps that are left, with the other processes, and has as many Gaussians as all steps
    /// of the run can put in place.
    pub fn leave_out(&mut self, kept: usize) {
        let most = self.keeping.and_then(|keeping| keeping.gaussians).map(|most| {
            let (fit, camera) = (self.fit().settings(), &self.fit().photo(0).camera);
            let done = self.fit().steps_done();
            let steps = done - fit.left_out(done) + kept;
            let pixels = (steps * fit.views_per_step * camera.width * camera.height) as f64;
            most.min(most_gaussians(pixels) as usize)
        });
        self.capture.fit.leave_out(kept, most);
        self.settings.fit.thinned = self.fit().settings().thinned.clone();
        self.announce(Next::LeaveOut(kept));
    }

    pub fn fit(&self) -> &Fit {
        &self.capture.fit
    }

    /// Removes Gaussians that no photo needs.
    fn clean(&mut self) -> Result<(), Error> {
        let before = self.glances()?;
        let removed = self.capture.fit.clean(&CleaningRules::default())?;
        let held_out = before.zip(self.glances()?).map(|(before, after)| [before, after]);
        self.cleaning = (removed.count() > 0).then_some(Cleaning { removed, held_out });
        Ok(())
    }

    /// Steps of the most passes through the photos that the run may make.
    pub fn most_steps(&self) -> Option<usize> {
        let round = self.fit().photos().div_ceil(self.settings.fit.views_per_step);
        self.settings.most_rounds.map(|rounds| rounds * round)
    }

    /// Seconds since the run began, with earlier sessions.
    pub fn seconds(&self) -> f64 {
        self.before + self.started.elapsed().as_secs_f64()
    }
}

impl Job for Fitting {
    type Error = Error;

    fn steps(&self) -> [usize; 2] {
        [self.fit().steps_done(), self.fit().settings().steps]
    }

    fn step(&mut self) -> Result<StepReport, Error> {
        self.announce(Next::Step);
        let before = self.fit().steps_done();
        let weaver_fit::StepReport { step, loss, psnr, gaussians, pairs, .. } = self.capture.fit.step()?;
        let mut scalars = vec![
            Scalar::mean("psnr", psnr),
            Scalar::last("gaussians", gaussians as f64),
            Scalar::mean("pairs", pairs as f64 / 1e6),
        ];
        if self.settings.fit.clean && step >= self.settings.fit.steps {
            self.clean()?;
        }
        scalars.extend(self.look(before)?.map(|psnr| Scalar::last(HELD_OUT, psnr)));
        Ok(StepReport { step, of: self.steps()[1], loss, scalars, ..StepReport::default() })
    }

    fn state(&mut self) -> Result<Tensors, Error> {
        self.capture.fit.fetch()?;
        let mut state = self.fit().state();
        state.metadata.insert(SECONDS.into(), format!("{:.3}", self.seconds()));
        if let Some(cleaning) = &self.cleaning {
            state.metadata.insert(CLEANING.into(), json!(cleaning).to_string());
        }
        Ok(state)
    }

    fn restore(&mut self, state: &Tensors) -> Result<(), Error> {
        self.capture.fit.restore(state)?;
        self.before = state.metadata.get(SECONDS).and_then(|s| s.parse().ok()).unwrap_or(0.0);
        // An older version wrote something else there.
        self.cleaning = state.metadata.get(CLEANING).and_then(|text| serde_json::from_str(text).ok());
        Ok(())
    }

    fn stepped(&mut self, folder: &Folder) -> Result<(), Error> {
        self.keep_pace(folder)
    }

    fn rhythm(&self) -> Rhythm {
        Rhythm { log: Log::Means(RECORDS), save: Save::Seconds(self.settings.save_every) }
    }
}
