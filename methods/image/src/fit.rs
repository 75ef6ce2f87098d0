//! Fitting of Gaussians to a picture.

use crate::adam::Rates;
use crate::bounds::Bounds;
use crate::canvas::Canvas;
use crate::colors::{round_colors, solve_colors};
use crate::error::{ImageError, range};
use crate::gaussians::Gaussians;
use crate::picture::Picture;
use crate::rounding::{Grid, Parts};
use crate::settings::{Descent, FitSettings};
use crate::start::start;
use crate::state::FitState;
use crate::step::Step;
use crate::window::Window;
use std::ops::ControlFlow;

/// Part of the rates at the end.
const LAST_RATE: f32 = 0.05;
/// Number of additions of Gaussians, one every twelfth of the steps.
const ADDITIONS: usize = 5;
const PERIODS: usize = 12;
/// Parts of the steps after which shapes and positions are rounded, for a file.
const SHAPES_AT: f64 = 0.6;
const POSITIONS_AT: f64 = 0.8;
/// Part of the steps after which a straight-through estimate begins.
const THROUGH_AT: f64 = 2.0 / 3.0;
/// Most Gaussians of a picture of one color.
const OF_ONE_COLOR: usize = 64;

/// Report of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Its number, from 1.
    pub step: usize,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// The loss before it: the mean squared error, or the published loss.
    pub loss: f64,
}

/// A fitted picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// The Gaussians; fewer than wanted, if the start found no room for all.
    pub gaussians: Gaussians<f32>,
    /// Cut of the drawing, standard deviations.
    pub cut: f64,
    /// Gaussians that were reset because of a NaN or an infinity.
    pub reset: usize,
}

impl Fitted {
    /// Draws the picture at its own size, `[H, W, 3]`, clamped to [0, 1].
    ///
    /// # Errors
    /// As [`Canvas::place`].
    pub fn draw(&self, width: usize, height: usize) -> Result<Vec<f32>, ImageError> {
        self.draw_window(Window::whole(width, height))
    }

    /// Draws a window of the picture, `[h, w, 3]`, clamped to [0, 1].
    ///
    /// # Errors
    /// As [`Canvas::place`].
    pub fn draw_window(&self, window: Window) -> Result<Vec<f32>, ImageError> {
        let mut canvas = Canvas::new();
        canvas.place(&self.gaussians, window, self.cut)?;
        let mut image = vec![0.0; 3 * window.pixels()];
        canvas.draw(&self.gaussians.colors, &mut image)?;
        image.iter_mut().for_each(|x| *x = x.clamp(0.0, 1.0));
        Ok(image)
    }
}

/// Fits Gaussians to a picture. `observe` is called after every step and may end the fit.
///
/// The same bits from the same settings, at any number of threads. Scales stay between 0.3 pixels and a quarter of the
/// longer side. A picture of one color gets 64 Gaussians at most. [`Fit`] is the same step by step.
///
/// # Errors
/// No Gaussians or more than pixels.
///
/// ```
/// use std::ops::ControlFlow;
/// use weaver_image::{FitSettings, Picture, fit};
/// let colors = (0..32 * 32 * 3).map(|i| if i % 96 < 48 { 0.2 } else { 0.8 }).collect();
/// let picture = Picture::new(32, 32, colors)?;
/// let mut last = f64::INFINITY;
/// fit(&picture, &FitSettings::new(16, 60), &mut |progress| {
///     last = progress.loss;
///     ControlFlow::Continue(())
/// })?;
/// assert!(last < 0.005);
/// # Ok::<(), weaver_image::ImageError>(())
/// ```
pub fn fit(
    picture: &Picture,
    settings: &FitSettings,
    observe: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Fitted, ImageError> {
    run(Fit::new(picture, settings)?, picture, observe)
}

/// Fits from existing Gaussians, by the steps of [`fit`] after its start.
///
/// # Errors
/// As [`fit`], and Gaussians that [`Gaussians::check`] refuses.
pub fn refine(
    picture: &Picture,
    settings: &FitSettings,
    gaussians: Gaussians<f32>,
    observe: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Fitted, ImageError> {
    run(Fit::at(picture, settings, FitState::new(gaussians))?, picture, observe)
}

fn run(
    mut fit: Fit,
    picture: &Picture,
    observe: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Fitted, ImageError> {
    while !fit.is_done() {
        if observe(fit.step(picture)?).is_break() {
            break;
        }
    }
    fit.finish(picture)
}

/// A fit under way, step by step, which can be interrupted at a [state](Self::state) and resumed with the same bits.
///
/// ```
/// use weaver_image::{Fit, FitSettings, Picture};
/// let picture = Picture::new(32, 32, (0..32 * 32 * 3).map(|i| (i % 96) as f32 / 96.0).collect())?;
/// let settings = FitSettings::new(16, 20);
/// let mut fit = Fit::new(&picture, &settings)?;
/// for _ in 0..10 {
///     fit.step(&picture)?;
/// }
/// let mut other = Fit::at(&picture, &settings, fit.state().clone())?;
/// while !fit.is_done() {
///     assert_eq!(fit.step(&picture)?, other.step(&picture)?);
/// }
/// assert_eq!(fit.finish(&picture)?, other.finish(&picture)?);
/// # Ok::<(), weaver_image::ImageError>(())
/// ```
#[derive(Debug)]
pub struct Fit {
    settings: FitSettings,
    size: [usize; 2],
    state: FitState,
    step: Step,
    bounds: Bounds,
    rates: Rates,
}

impl Fit {
    /// A fit at its start.
    ///
    /// # Errors
    /// No Gaussians or more than pixels.
    pub fn new(picture: &Picture, settings: &FitSettings) -> Result<Self, ImageError> {
        settings.check(picture)?;
        let mut settings = *settings;
        if picture.is_of_one_color() {
            settings.gaussians = settings.gaussians.min(OF_ONE_COLOR);
        }
        let grows = settings.growth && settings.steps > 0;
        let first = if grows { settings.gaussians.div_ceil(2) } else { settings.gaussians };
        let mut gaussians = start(picture, first, settings.start, settings.seed);
        Bounds::new(picture).apply(&mut gaussians);
        if settings.color_steps > 0 {
            solve_colors(picture, &mut gaussians, settings.descent.cut(), settings.color_steps)?;
        }
        Self::at(picture, &settings, FitState::new(gaussians))
    }

    /// A fit resumed at a state of the same picture and settings.
    ///
    /// # Errors
    /// As [`new`](Self::new), and a state of other numbers than this fit can have.
    pub fn at(picture: &Picture, settings: &FitSettings, state: FitState) -> Result<Self, ImageError> {
        settings.check(picture)?;
        state.check(picture, settings)?;
        Ok(Self {
            settings: *settings,
            size: [picture.width, picture.height],
            state,
            step: Step::new(picture, settings)?,
            bounds: Bounds::new(picture),
            rates: settings.descent.rates(picture),
        })
    }

    /// State after the finished steps.
    pub fn state(&self) -> &FitState {
        &self.state
    }

    /// The settings; with fewer Gaussians than wanted for a picture of one color.
    pub fn settings(&self) -> &FitSettings {
        &self.settings
    }

    /// True after the last step.
    pub fn is_done(&self) -> bool {
        self.state.step >= self.settings.steps as u64
    }

    /// Does the next step on the picture of the fit.
    ///
    /// # Errors
    /// A picture of another size; Gaussians over too many tiles.
    pub fn step(&mut self, picture: &Picture) -> Result<Progress, ImageError> {
        self.check(picture)?;
        let number = self.state.step as usize + 1;
        let more = self.wanted(number) - self.wanted(number - 1);
        if more > 0 {
            self.step.grow(picture, &self.settings, &mut self.state.gaussians, more, number)?;
        }
        let through = self.settings.straight_through && number as f64 > THROUGH_AT * self.settings.steps as f64;
        let loss = match through {
            true => self.step.gradient(picture, number, &self.all_rounded())?,
            false => self.step.gradient(picture, number, &self.state.gaussians)?,
        };
        let left = match self.settings.descent {
            Descent::Squared => LAST_RATE.powf(number as f32 / self.settings.steps as f32),
            Descent::Published => 1.0,
        };
        let frozen = self.rounded(number - 1);
        let mut rates = self.rates.times(left);
        if frozen.shape {
            (rates.scale, rates.angle) = (0.0, 0.0);
        }
        if frozen.position {
            rates.center = [0.0; 2];
        }
        // The squares of the derivatives of a mean would underflow.
        self.step.move_by(&mut self.state, &rates, picture.pixels() as f32);
        self.bounds.restore(&mut self.state);
        // A rounded scale may lie a little beyond the bounds.
        if !frozen.shape {
            self.bounds.apply(&mut self.state.gaussians);
        }
        self.state.step = number as u64;
        self.round(frozen, self.rounded(number));
        Ok(Progress { step: number, gaussians: self.state.gaussians.len(), loss })
    }

    /// The picture after the finished steps, rounded if it is to be coded.
    ///
    /// # Errors
    /// As [`step`](Self::step).
    pub fn finish(mut self, picture: &Picture) -> Result<Fitted, ImageError> {
        self.check(picture)?;
        let cut = self.settings.descent.cut();
        if self.settings.straight_through {
            return Ok(Fitted { gaussians: self.all_rounded(), cut, reset: self.state.reset as usize });
        }
        if self.settings.coded {
            self.round(self.rounded(self.state.step as usize), self.rounded(self.settings.steps));
        }
        let Self { settings, state, step, .. } = self;
        // It holds memory of the size of several pictures.
        drop(step);
        let FitState { mut gaussians, reset, .. } = state;
        if settings.coded {
            round_colors(picture, &mut gaussians, &Grid { size: [picture.width, picture.height] }, cut, settings.seed)?;
        }
        Ok(Fitted { gaussians, cut, reset: reset as usize })
    }

    fn check(&self, picture: &Picture) -> Result<(), ImageError> {
        let found = [picture.width, picture.height];
        match found == self.size {
            true => Ok(()),
            false => Err(range("picture of a fit", format!("{:?} pixels", self.size), format!("{found:?}"))),
        }
    }

    /// Number of Gaussians in a step.
    fn wanted(&self, number: usize) -> usize {
        let first = self.state.first as usize;
        let missing = if self.settings.growth { self.settings.gaussians.saturating_sub(first) } else { 0 };
        first + missing * (number * PERIODS / self.settings.steps).min(ADDITIONS) / ADDITIONS
    }

    fn all_rounded(&self) -> Gaussians<f32> {
        let (grid, mut out) = (Grid { size: self.size }, self.state.gaussians.clone());
        let all = Parts { shape: true, position: true, color: true };
        (0..out.len()).for_each(|i| grid.round(&mut out, i, all));
        out
    }

    /// Parts that are rounded after `steps` steps, and frozen from then on.
    fn rounded(&self, steps: usize) -> Parts {
        let staged = self.settings.coded && !self.settings.straight_through;
        let due = |part: f64| staged && steps as f64 >= part * self.settings.steps as f64;
        Parts { shape: due(SHAPES_AT), position: due(POSITIONS_AT), color: false }
    }

    /// Rounds the parts of `after` that are not in `before`.
    fn round(&mut self, before: Parts, after: Parts) {
        let parts =
            Parts { shape: after.shape && !before.shape, position: after.position && !before.position, color: false };
        if parts != Parts::default() {
            let grid = Grid { size: self.size };
            (0..self.state.gaussians.len()).for_each(|i| grid.round(&mut self.state.gaussians, i, parts));
        }
    }
}
