//! Fitting of Gaussians to a picture.

use crate::adam::{Adam, Rates};
use crate::canvas::Canvas;
use crate::colors::{round_colors, solve_colors};
use crate::error::ImageError;
use crate::gaussians::{Gaussians, LEAST_SCALE};
use crate::picture::Picture;
use crate::rounding::{Grid, Parts};
use crate::sampling::weighted_sample;
use crate::settings::{Descent, FitSettings};
use crate::start::start;
use crate::window::{Tiled, Window};
use std::ops::ControlFlow;
use weaver_kernels::random::Stream;
use weaver_losses::Photometric;

/// Part of the rates that is left at the end.
const LAST_RATE: f32 = 0.05;
/// Weight of the structural similarity in the published loss.
const SIMILARITY: f64 = 0.2;
/// Times that Gaussians are added, one every twelfth of the steps.
const ADDITIONS: usize = 5;
const PERIODS: usize = 12;
/// Parts of the steps after which shapes and positions are rounded, for a file.
const SHAPES_AT: f64 = 0.6;
const POSITIONS_AT: f64 = 0.8;

/// A step that was made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Its number, from 1.
    pub step: usize,
    /// Gaussians at the time.
    pub gaussians: usize,
    /// The loss before it: the mean squared error, or the published loss.
    pub loss: f64,
}

/// A fitted picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// The Gaussians; there may be fewer than asked for, where the start found no room.
    pub gaussians: Gaussians<f32>,
    /// Standard deviations at which they end, to be drawn with.
    pub cut: f64,
    /// Gaussians that were reset because a number of theirs was none.
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
/// The same bits from the same settings, at any number of threads. Scales stay between 0.3 pixels and a quarter of the longer side.
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
    settings.check(picture)?;
    let first = if settings.growth && settings.steps > 0 { settings.gaussians.div_ceil(2) } else { settings.gaussians };
    let mut state = start(picture, first, settings.start, settings.seed);
    let bounds = Bounds::new(picture);
    bounds.apply(&mut state);
    if settings.color_steps > 0 {
        solve_colors(picture, &mut state, settings.descent.cut(), settings.color_steps)?;
    }
    refine(picture, settings, state, observe)
}

/// Goes on with Gaussians that are there already, by the steps of [`fit`] after its start.
///
/// # Errors
/// As [`fit`], and Gaussians that [`Gaussians::check`] refuses.
pub fn refine(
    picture: &Picture,
    settings: &FitSettings,
    mut state: Gaussians<f32>,
    observe: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Fitted, ImageError> {
    settings.check(picture)?;
    let bounds = Bounds::new(picture);
    let mut step = Step::new(picture, settings)?;
    let (mut adam, mut reset) = (Adam::default(), 0);
    let rates = settings.descent.rates(picture);
    let grid = Grid { size: [picture.width, picture.height] };
    let mut frozen = Frozen::default();
    let first = state.len();
    // Of derivatives of a mean, the squares would be below the least number.
    let scale = picture.pixels() as f32;
    for number in 1..=settings.steps {
        if settings.growth {
            let missing = settings.gaussians.saturating_sub(first);
            let wanted =
                |number: usize| first + missing * (number * PERIODS / settings.steps).min(ADDITIONS) / ADDITIONS;
            let more = wanted(number) - wanted(number - 1);
            if more > 0 {
                step.grow(picture, settings, &mut state, more, number)?;
            }
        }
        let loss = step.gradient(number, &state)?;
        let left = match settings.descent {
            Descent::Squared => LAST_RATE.powf(number as f32 / settings.steps as f32),
            Descent::Published => 1.0,
        };
        step.move_by(&mut adam, &mut state, &frozen.rates(rates.times(left)), scale);
        reset += bounds.restore(&mut state, &mut adam);
        // A rounded scale may lie a little beyond the bounds.
        if !frozen.shape {
            bounds.apply(&mut state);
        }
        if settings.coded {
            frozen.advance(number, settings.steps, &grid, &mut state);
        }
        if observe(Progress { step: number, gaussians: state.len(), loss }).is_break() {
            break;
        }
    }
    let cut = settings.descent.cut();
    if settings.coded {
        frozen.advance(settings.steps, settings.steps, &grid, &mut state);
        round_colors(picture, &mut state, &grid, cut, settings.seed)?;
    }
    Ok(Fitted { gaussians: state, cut, reset })
}

/// Numbers that are rounded already, and do not move any more.
#[derive(Default)]
struct Frozen {
    shape: bool,
    position: bool,
}

impl Frozen {
    fn rates(&self, mut rates: Rates) -> Rates {
        if self.shape {
            (rates.scale, rates.angle) = (0.0, 0.0);
        }
        if self.position {
            rates.center = [0.0; 2];
        }
        rates
    }

    /// Rounds what is due after a step.
    fn advance(&mut self, number: usize, steps: usize, grid: &Grid, state: &mut Gaussians<f32>) {
        let mut parts = Parts::default();
        for (due, done, part) in
            [(SHAPES_AT, &mut self.shape, &mut parts.shape), (POSITIONS_AT, &mut self.position, &mut parts.position)]
        {
            if !*done && number as f64 >= due * steps as f64 {
                (*done, *part) = (true, true);
            }
        }
        if parts != Parts::default() {
            (0..state.len()).for_each(|i| grid.round(state, i, parts));
        }
    }
}

/// The range of scales, and what a lost Gaussian is set to.
struct Bounds {
    largest: f32,
    middle: [f32; 2],
    pixels: f32,
}

impl Bounds {
    fn new(picture: &Picture) -> Self {
        let largest = (0.25 * picture.width.max(picture.height) as f32).max(2.0 * LEAST_SCALE);
        let middle = [picture.width, picture.height].map(|side| 0.5 * side as f32);
        Self { largest, middle, pixels: picture.pixels() as f32 }
    }

    /// Bounds scales. The published scale is an absolute value.
    fn apply(&self, gaussians: &mut Gaussians<f32>) {
        gaussians.scales.iter_mut().for_each(|s| *s = s.abs().clamp(LEAST_SCALE, self.largest));
    }

    /// Resets Gaussians that hold a number that is none; returns how many.
    fn restore(&self, gaussians: &mut Gaussians<f32>, adam: &mut Adam) -> usize {
        let count = gaussians.len();
        let mut reset = 0;
        for i in 0..count {
            let lists = [
                &gaussians.centers[2 * i..2 * i + 2],
                &gaussians.scales[2 * i..2 * i + 2],
                &gaussians.angles[i..=i],
                &gaussians.colors[3 * i..3 * i + 3],
            ];
            if lists.into_iter().flatten().all(|x| x.is_finite()) {
                continue;
            }
            gaussians.centers[2 * i..2 * i + 2].copy_from_slice(&self.middle);
            gaussians.scales[2 * i..2 * i + 2].fill(0.4 * (self.pixels / count as f32).sqrt());
            gaussians.angles[i] = 0.0;
            gaussians.colors[3 * i..3 * i + 3].fill(0.0);
            adam.forget(i);
            reset += 1;
        }
        reset
    }
}

/// The gradient of a step, and its memory.
struct Step<'a> {
    picture: &'a Picture,
    descent: Descent,
    /// For the squared error: the picture, and half of it for the first steps.
    tiled: Option<Tiled<f32>>,
    half: Option<(Tiled<f32>, usize)>,
    canvas: Canvas<f32>,
    gradient: Gaussians<f32>,
    published: Photometric<f32>,
    image: Vec<f32>,
    slopes: Vec<f32>,
}

impl<'a> Step<'a> {
    fn new(picture: &'a Picture, settings: &FitSettings) -> Result<Self, ImageError> {
        let tiled = |picture: &Picture| Tiled::new(&picture.colors, picture.width, picture.height);
        let squared = settings.descent == Descent::Squared;
        let half = settings.coarse && squared && picture.width.min(picture.height) > 1;
        Ok(Self {
            picture,
            descent: settings.descent,
            tiled: if squared { Some(tiled(picture)?) } else { None },
            half: if half { Some((tiled(&picture.half())?, settings.steps / 2)) } else { None },
            canvas: Canvas::new(),
            gradient: Gaussians::default(),
            published: Photometric::new(),
            image: vec![0.0; picture.colors.len()],
            slopes: vec![0.0; if squared { 0 } else { picture.colors.len() }],
        })
    }

    /// Leaves the gradient of the loss in `gradient`, and returns the loss.
    fn gradient(&mut self, number: usize, state: &Gaussians<f32>) -> Result<f64, ImageError> {
        let cut = self.descent.cut();
        match (&self.tiled, &self.half) {
            (Some(_), Some((half, until))) if number <= *until => {
                let small = state.at_scale(0.5);
                let [width, height] = half.size();
                self.canvas.place(&small, Window::whole(width, height), cut)?;
                let loss = self.canvas.squared_error(&small, half, &mut self.gradient)?;
                state.pull_back(0.5, &mut self.gradient);
                Ok(loss)
            }
            (Some(tiled), _) => {
                self.canvas.place(state, self.picture.window(), cut)?;
                self.canvas.squared_error(state, tiled, &mut self.gradient)
            }
            (None, _) => self.published_gradient(state),
        }
    }

    fn published_gradient(&mut self, state: &Gaussians<f32>) -> Result<f64, ImageError> {
        self.canvas.place(state, self.picture.window(), self.descent.cut())?;
        self.canvas.draw(&state.colors, &mut self.image)?;
        let clamped: Vec<f32> = self.image.iter().map(|x| x.clamp(0.0, 1.0)).collect();
        let size = [self.picture.height, self.picture.width];
        let loss =
            self.published.value_and_gradient(&clamped, &self.picture.colors, size, SIMILARITY, &mut self.slopes);
        for (slope, x) in self.slopes.iter_mut().zip(&self.image) {
            if !(0.0..=1.0).contains(x) {
                *slope = 0.0;
            }
        }
        self.canvas.backward(state, &self.slopes, &mut self.gradient)?;
        Ok(loss.loss)
    }

    fn move_by(&mut self, adam: &mut Adam, state: &mut Gaussians<f32>, rates: &Rates, scale: f32) {
        if self.descent == Descent::Squared {
            return adam.step(state, &self.gradient, rates, scale);
        }
        // The published angle is 2 pi sigmoid of the number that is optimized.
        let turn = std::f32::consts::TAU;
        let part = |angle: f32| (angle / turn).clamp(1e-6, 1.0 - 1e-6);
        for (slope, angle) in self.gradient.angles.iter_mut().zip(&mut state.angles) {
            let part = part(*angle);
            *slope *= turn * part * (1.0 - part);
            *angle = (part / (1.0 - part)).ln();
        }
        adam.step(state, &self.gradient, rates, scale);
        state.angles.iter_mut().for_each(|logit| *logit = turn / (1.0 + (-*logit).exp()));
    }

    /// Adds Gaussians at pixels drawn by squared error, with half of what is missing there as color.
    fn grow(
        &mut self,
        picture: &Picture,
        settings: &FitSettings,
        state: &mut Gaussians<f32>,
        count: usize,
        number: usize,
    ) -> Result<(), ImageError> {
        self.canvas.place(state, picture.window(), self.descent.cut())?;
        self.canvas.draw(&state.colors, &mut self.image)?;
        self.image.iter_mut().zip(&picture.colors).for_each(|(drawn, color)| *drawn = color - *drawn);
        let square = |pixel: &[f32]| pixel.iter().map(|x| f64::from(x * x)).sum::<f64>();
        let errors: Vec<f64> = self.image.chunks_exact(3).map(square).collect();
        let scale = 0.4 * (picture.pixels() as f32 / settings.gaussians as f32).sqrt();
        let stream = Stream::new(settings.seed, number as u64, "image.growth");
        for p in weighted_sample(&errors, count, stream) {
            let center = [p % picture.width, p / picture.width].map(|x| x as f32 + 0.5);
            let missing = &self.image[3 * p..3 * p + 3];
            state.push(center, [scale; 2], 0.0, [0, 1, 2].map(|c| 0.5 * missing[c]));
        }
        Ok(())
    }
}
