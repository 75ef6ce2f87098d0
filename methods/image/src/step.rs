//! The gradient of a step of a fit, and growth.

use crate::adam::Rates;
use crate::canvas::Canvas;
use crate::error::ImageError;
use crate::gaussians::Gaussians;
use crate::picture::Picture;
use crate::sampling::weighted_sample;
use crate::settings::{Descent, FitSettings};
use crate::state::FitState;
use crate::window::{Tiled, Window};
use weaver_kernels::random::Stream;
use weaver_losses::Photometric;

/// Weight of the structural similarity in the published loss.
const SIMILARITY: f64 = 0.2;

/// The gradient of a step, and its memory.
#[derive(Debug)]
pub struct Step {
    descent: Descent,
    /// Targets of the squared error: the picture, and its half size for the first steps.
    tiled: Option<Tiled<f32>>,
    half: Option<(Tiled<f32>, usize)>,
    canvas: Canvas<f32>,
    gradient: Gaussians<f32>,
    published: Photometric<f32>,
    image: Vec<f32>,
    slopes: Vec<f32>,
}

impl Step {
    pub fn new(picture: &Picture, settings: &FitSettings) -> Result<Self, ImageError> {
        let tiled = |picture: &Picture| Tiled::new(&picture.colors, picture.width, picture.height);
        let squared = settings.descent == Descent::Squared;
        let half = settings.coarse && squared && picture.width.min(picture.height) > 1;
        Ok(Self {
            descent: settings.descent,
            tiled: if squared { Some(tiled(picture)?) } else { None },
            half: if half { Some((tiled(&picture.half())?, settings.steps / 2)) } else { None },
            canvas: Canvas::new(),
            gradient: Gaussians::default(),
            published: Photometric::new(),
            image: vec![0.0; if squared { 0 } else { picture.colors.len() }],
            slopes: vec![0.0; if squared { 0 } else { picture.colors.len() }],
        })
    }

    /// Leaves the gradient of the loss in `gradient`, and returns the loss.
    pub fn gradient(&mut self, picture: &Picture, number: usize, state: &Gaussians<f32>) -> Result<f64, ImageError> {
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
                self.canvas.place(state, picture.window(), cut)?;
                self.canvas.squared_error(state, tiled, &mut self.gradient)
            }
            (None, _) => self.published_gradient(picture, state),
        }
    }

    fn published_gradient(&mut self, picture: &Picture, state: &Gaussians<f32>) -> Result<f64, ImageError> {
        self.canvas.place(state, picture.window(), self.descent.cut())?;
        self.canvas.draw(&state.colors, &mut self.image)?;
        let clamped: Vec<f32> = self.image.iter().map(|x| x.clamp(0.0, 1.0)).collect();
        let size = [picture.height, picture.width];
        let loss = self.published.value_and_gradient(&clamped, &picture.colors, size, SIMILARITY, &mut self.slopes);
        for (slope, x) in self.slopes.iter_mut().zip(&self.image) {
            if !(0.0..=1.0).contains(x) {
                *slope = 0.0;
            }
        }
        self.canvas.backward(state, &self.slopes, &mut self.gradient)?;
        Ok(loss.loss)
    }

    /// Moves the Gaussians along the negative gradient times `scale`.
    pub fn move_by(&mut self, state: &mut FitState, rates: &Rates, scale: f32) {
        if self.descent == Descent::Squared {
            return state.adam(&self.gradient, rates, scale);
        }
        // The published angle is 2 pi sigmoid of the optimized number.
        let turn = std::f32::consts::TAU;
        let part = |angle: f32| (angle / turn).clamp(1e-6, 1.0 - 1e-6);
        for (slope, angle) in self.gradient.angles.iter_mut().zip(&mut state.gaussians.angles) {
            let part = part(*angle);
            *slope *= turn * part * (1.0 - part);
            *angle = (part / (1.0 - part)).ln();
        }
        state.adam(&self.gradient, rates, scale);
        state.gaussians.angles.iter_mut().for_each(|logit| *logit = turn / (1.0 + (-*logit).exp()));
    }

    /// Adds Gaussians at pixels drawn by squared error, with half of the residual there as color.
    pub fn grow(
        &mut self,
        picture: &Picture,
        settings: &FitSettings,
        state: &mut Gaussians<f32>,
        count: usize,
        number: usize,
    ) -> Result<(), ImageError> {
        let mut missing = vec![0.0; picture.colors.len()];
        self.canvas.place(state, picture.window(), self.descent.cut())?;
        self.canvas.draw(&state.colors, &mut missing)?;
        missing.iter_mut().zip(&picture.colors).for_each(|(drawn, color)| *drawn = color - *drawn);
        let square = |pixel: &[f32]| pixel.iter().map(|x| f64::from(x * x)).sum::<f64>();
        let errors: Vec<f64> = missing.chunks_exact(3).map(square).collect();
        let scale = 0.4 * (picture.pixels() as f32 / settings.gaussians as f32).sqrt();
        let stream = Stream::new(settings.seed, number as u64, "image.growth");
        for p in weighted_sample(&errors, count, stream) {
            let center = [p % picture.width, p / picture.width].map(|x| x as f32 + 0.5);
            state.push(center, [scale; 2], 0.0, [0, 1, 2].map(|c| 0.5 * missing[3 * p + c]));
        }
        Ok(())
    }
}
