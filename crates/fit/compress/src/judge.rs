//! Quality by pictures.

use crate::CompressError;
use weaver_geometry::Camera;
use weaver_scene::{ActivatedGaussians, Gaussians};
use weaver_splat::{RasterSettings, Renderer};

/// The least mean square that counts as an error: pictures that agree better are equal to the eye and to 8 bits.
const LEAST: f64 = 1e-10;

/// The pictures that a scene is judged by.
#[derive(Clone, Copy, Debug)]
pub struct Pictures<'a> {
    /// Their cameras.
    pub cameras: &'a [Camera],
    /// The color behind the scene.
    pub background: [f32; 3],
    /// Settings of drawing.
    pub settings: RasterSettings,
}

/// Compares scenes with one by their pictures, values clamped to [0, 1].
#[derive(Debug)]
pub struct Judge {
    cameras: Vec<Camera>,
    background: [f32; 3],
    settings: RasterSettings,
    renderer: Renderer,
    expected: Vec<Vec<f32>>,
}

impl Judge {
    /// Draws the scene that others are compared with.
    ///
    /// # Errors
    /// Without cameras, and where the scene cannot be drawn.
    pub fn new(gaussians: &Gaussians, pictures: &Pictures<'_>) -> Result<Self, CompressError> {
        let Pictures { cameras, background, settings } = *pictures;
        if cameras.is_empty() {
            return Err(CompressError::NoCameras);
        }
        let (cameras, renderer) = (cameras.to_vec(), Renderer::default());
        let mut judge = Self { cameras, background, settings, renderer, expected: Vec::new() };
        judge.expected = judge.draw(&gaussians.to_activated())?;
        Ok(judge)
    }

    /// Mean square difference of the pictures of a scene.
    ///
    /// # Errors
    /// If it cannot be drawn.
    pub fn mean_square(&mut self, gaussians: &Gaussians) -> Result<f64, CompressError> {
        let squares = self.squares(gaussians)?;
        Ok(squares.iter().sum::<f64>() / squares.len() as f64)
    }

    /// Mean over the pictures of `20 log10(1 / √MSE)`, dB; at most 100 for each.
    ///
    /// # Errors
    /// If the scene cannot be drawn.
    pub fn psnr(&mut self, gaussians: &Gaussians) -> Result<f64, CompressError> {
        let squares = self.squares(gaussians)?;
        Ok(squares.iter().map(|square| -10.0 * square.max(LEAST).log10()).sum::<f64>() / squares.len() as f64)
    }

    /// Mean square difference of each picture.
    fn squares(&mut self, gaussians: &Gaussians) -> Result<Vec<f64>, CompressError> {
        let drawn = self.draw(&gaussians.to_activated())?;
        let of = |(a, b): (&Vec<f32>, &Vec<f32>)| {
            let squares: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
            squares / a.len().max(1) as f64
        };
        Ok(drawn.iter().zip(&self.expected).map(of).collect())
    }

    /// One picture after the other, since sizes may differ.
    fn draw(&mut self, gaussians: &ActivatedGaussians) -> Result<Vec<Vec<f32>>, CompressError> {
        let mut pictures = Vec::with_capacity(self.cameras.len());
        for camera in &self.cameras {
            let mut picture = self.renderer.render(gaussians, &[*camera], self.background, &self.settings)?.concat();
            picture.iter_mut().for_each(|x| *x = x.clamp(0.0, 1.0));
            pictures.push(picture);
        }
        Ok(pictures)
    }
}
