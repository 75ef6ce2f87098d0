//! The cameras of photos, from first guesses.

use super::drawing::{Drawing, Level, Loss, Photo, Scene};
use super::{AlignError, Descent, Method};
use std::f64::consts::PI;
use std::ops::Range;
use weaver_geometry::{Camera, so3};
use weaver_kernels::Real;
use weaver_splat::Rasterizer;

/// Options of the descent of cameras.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// The numbers that descend, and their rate.
    pub method: Method,
    /// Steps at most.
    pub steps: usize,
    /// [`Method::Own`] alone: whether photo and render are blurred for the first half, by 2 pixels of 64.
    pub blur: bool,
    /// True if focal lengths descend as well.
    pub intrinsics: bool,
}

impl Options {
    /// The method with as many steps as published, ours with 200.
    pub fn of(method: Method) -> Self {
        let steps = if method == Method::Own { 200 } else { 100 };
        Self { method, steps, blur: true, intrinsics: false }
    }

    /// The same in another number of steps, if one is given.
    #[must_use]
    pub fn in_steps(self, steps: Option<usize>) -> Self {
        Self { steps: steps.unwrap_or(self.steps), ..self }
    }
}

/// Outcome of a photo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// Its camera was found, as far as the loss shows.
    Found,
    /// The photo has one color, or the scene under it: nothing says where to go. The guess stands.
    Flat,
    /// Hardly anything of the scene is seen from the guess, which stands: this part of the pixels.
    Unseen(f64),
    /// No camera on the way was better than the guess, which stands.
    NotBetter,
}

/// A photo's camera.
#[derive(Clone, Debug)]
pub struct Aligned<T> {
    /// The camera.
    pub camera: Camera,
    /// Its view, `[height, width, 3]`, values not clamped.
    pub image: Vec<T>,
    /// The loss before each step and at the end: at half the size and blurred in our method's first half.
    pub losses: Vec<f64>,
    /// The loss from the guess and from the camera, at the photo's size.
    pub loss: [f64; 2],
    /// Movement of the camera, degrees, and of its center, in parts of the mean depth that the guess sees.
    pub moved: [f64; 2],
    /// End of the descent: a camera that was found, or the reason why the guess stands.
    pub outcome: Outcome,
}

/// Alpha at the guess below which our method leaves a pixel out: moving into the void must not pay.
const COVERED: f64 = 0.5;
/// Part of the pixels that must be covered.
const LEAST_COVERED: f64 = 0.05;
/// Our method: blur of the first half in pixels of 64, the least side that is halved, and the factor on the rate at the
/// end.
const BLUR: f64 = 2.0 / 64.0;
const LEAST_SIDE: usize = 16;
const RATE_END: f64 = 0.02;
/// Our method slows down when this many steps gain less than this part of the loss, and ends when it has by so much; a
/// loss this many times the last undoes a step.
const PATIENCE: usize = 20;
const LEAST_GAIN: f64 = 1e-3;
const SLOWEST: f64 = 1.0 / 32.0;
const WORSE: f64 = 1.5;
/// Growth of a rate that was halved with each step that does not have to be undone.
const EASE: f64 = 1.2;

/// Finds the camera of each photo by descending from its guess, with Adam, on a loss between its render and the photo:
/// [`mean_square`](super::mean_square) or one's own, values in the scale of colors. Of one's own, four parts of mean
/// absolute differences to one of structure (1 - SSIM) find nearly every camera that is 4 degrees off, where squares
/// miss one in four. Photos are independent of one another.
///
/// [`Method::Own`] goes down a cosine to 2 % of the rate, the first half at half the size, blurred, and returns the
/// best camera that it has seen at full size; the published methods are as published: NoPoSplat's ends with its last
/// step, 2Xplat's with the camera of its last drawing before that. A failure is an [`Outcome`], and then the guess
/// stands. Same bits at any number of threads.
///
/// # Errors
///
/// Photos whose numbers do not fit, are not finite, or are masked altogether; errors of the rasterizer.
pub fn align<T: Real>(
    rasterizer: &dyn Rasterizer<T>,
    scene: &Scene<'_, T>,
    photos: &[Photo<'_, T>],
    options: &Options,
    mut loss: impl FnMut(&[T], &[T], [usize; 2], &mut [T]) -> f64,
) -> Result<Vec<Aligned<T>>, AlignError> {
    if !(scene.unit > 0.0 && scene.unit.is_finite()) {
        return Err(AlignError::Unit(scene.unit));
    }
    photos.iter().enumerate().try_for_each(|(i, photo)| photo.check(i))?;
    let mut drawing = Drawing::new(scene, rasterizer);
    photos.iter().map(|photo| one(&mut drawing, scene.unit, photo, options, &mut loss)).collect()
}

fn one<T: Real>(
    drawing: &mut Drawing<'_, T>,
    unit: f64,
    photo: &Photo<'_, T>,
    options: &Options,
    loss: &mut Loss<'_, T>,
) -> Result<Aligned<T>, AlignError> {
    let own = options.method == Method::Own;
    let guess = photo.camera;
    drawing.draw(&guess, 1.0)?;
    let covered: Vec<bool> = drawing.alpha.iter().map(|alpha| alpha.to_f64() >= COVERED).collect();
    let [alpha, depth] = [&drawing.alpha, &drawing.depth].map(|plane| plane.iter().map(|x| x.to_f64()).sum::<f64>());
    let mean_depth = depth / alpha.max(f64::MIN_POSITIVE);
    let share = covered.iter().filter(|covered| **covered).count() as f64 / covered.len() as f64;
    let counts = |at: usize| photo.mask.is_none_or(|mask| mask[at]) && (covered[at] || !own);
    let level = Level {
        pixels: photo.pixels.to_vec(),
        counts: (0..covered.len()).map(counts).collect(),
        shrink: 1.0,
        blur: 0.0,
    };
    let start = drawing.loss(&guess, &level, loss)?;
    let (viewmat, _) = drawing.gradient(&guess, &level)?;
    let hopeless = if share < LEAST_COVERED || !level.counts.contains(&true) {
        Some(Outcome::Unseen(share))
    } else {
        (viewmat.iter().all(|g| *g == 0.0) && start > 0.0).then_some(Outcome::Flat)
    };
    let descent = Descent::new(options.method, guess, if own { mean_depth } else { unit });
    let mut path = Path { drawing, loss, options, descent, best: (start, guess), losses: Vec::new() };
    match hopeless {
        Some(_) => {}
        None if own => path.halves(&level)?,
        None => path.published(&level)?,
    }
    let Path { best: (end, camera), losses, .. } = path;
    let camera = if end < start { camera } else { guess };
    drawing.draw(&camera, 1.0)?;
    let turned = camera.pose.relative_to(&guess.pose);
    let shifted = (camera.pose.center() - guess.pose.center()).length();
    Ok(Aligned {
        camera,
        image: drawing.image.clone(),
        losses,
        loss: [start, end.min(start)],
        moved: [
            so3::log(&turned.rotation).length().to_degrees(),
            shifted / if mean_depth > 0.0 { mean_depth } else { 1.0 },
        ],
        outcome: hopeless.unwrap_or(if end < start || start == 0.0 { Outcome::Found } else { Outcome::NotBetter }),
    })
}

/// The way of one camera.
struct Path<'p, 'a, T: Real> {
    drawing: &'p mut Drawing<'a, T>,
    loss: &'p mut Loss<'p, T>,
    options: &'p Options,
    descent: Descent,
    best: (f64, Camera),
    losses: Vec<f64>,
}

impl<T: Real> Path<'_, '_, T> {
    /// Our method: small and blurred, then as it is.
    fn halves(&mut self, level: &Level<T>) -> Result<(), AlignError> {
        let Camera { width, height, .. } = *self.descent.camera();
        let middle = self.options.steps / 2;
        if width.min(height) >= 2 * LEAST_SIDE {
            let blur = if self.options.blur { BLUR * width as f64 / 2.0 } else { 0.0 };
            self.descend(&Level { blur, ..level.halved([height, width]) }, 0..middle)?;
        }
        self.descend(level, middle..self.options.steps)?;
        self.see(level)?;
        Ok(())
    }

    /// Descends until it hardly helps any more.
    fn descend(&mut self, level: &Level<T>, steps: Range<usize>) -> Result<(), AlignError> {
        let mut first = self.losses.len();
        let (mut pace, mut brake, mut last) = (1.0, 1.0_f64, None);
        for step in steps {
            let value = self.see(level)?;
            let fraction = step as f64 / self.options.steps as f64;
            let rate = pace * (RATE_END + (1.0 - RATE_END) * 0.5 * (1.0 + (PI * fraction).cos()));
            if let Some((before, descent, slopes)) = &last
                && value > WORSE * before
            {
                brake *= 0.5;
                self.descent = Descent::clone(descent);
                self.step(slopes, brake * rate);
                continue;
            }
            if hardly_gains(&self.losses[first..]) {
                // At this rate it circles around the minimum.
                (first, pace) = (self.losses.len(), 0.5 * pace);
                if level.shrink > 1.0 || pace < SLOWEST {
                    break;
                }
            }
            // Near its end a descent often overshoots: a rate that was too large for one step may suit the next.
            brake = (EASE * brake).min(1.0);
            let slopes = self.drawing.gradient(self.descent.camera(), level)?;
            last = Some((value, self.descent.clone(), slopes));
            self.step(&slopes, brake * rate);
        }
        Ok(())
    }

    /// As published: so many steps at one rate, and the last camera at any loss.
    fn published(&mut self, level: &Level<T>) -> Result<(), AlignError> {
        // 2Xplat returns the camera of its last drawing, one step earlier.
        let last = if self.options.method == Method::TwoXplat { 1 } else { 0 };
        for _ in last..self.options.steps {
            self.see(level)?;
            let slopes = self.drawing.gradient(self.descent.camera(), level)?;
            self.step(&slopes, 1.0);
        }
        let end = self.see(level)?;
        self.best = (end, *self.descent.camera());
        Ok(())
    }

    fn step(&mut self, (viewmat, focal): &([f64; 12], [f64; 2]), rate: f64) {
        self.descent.step(viewmat, if self.options.intrinsics { *focal } else { [0.0; 2] }, rate);
    }

    /// The loss of where it is, which is remembered if it is the least at the photo's own size.
    fn see(&mut self, level: &Level<T>) -> Result<f64, AlignError> {
        let camera = *self.descent.camera();
        let value = self.drawing.loss(&camera, level, self.loss)?;
        if level.shrink == 1.0 && value < self.best.0 {
            self.best = (value, camera);
        }
        self.losses.push(value);
        Ok(value)
    }
}

/// True if the last steps have not brought the least loss down by more than a thousandth.
fn hardly_gains(losses: &[f64]) -> bool {
    let least = |losses: &[f64]| losses.iter().copied().fold(f64::INFINITY, f64::min);
    let before = losses.len().saturating_sub(PATIENCE);
    before > 0 && least(losses) > (1.0 - LEAST_GAIN) * least(&losses[..before])
}
