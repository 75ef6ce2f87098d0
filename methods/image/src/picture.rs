//! The input picture of a fit.

use crate::error::{ImageError, expect_len, range};
use crate::window::Window;

/// A picture in memory.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Columns.
    pub(crate) width: usize,
    /// Rows.
    pub(crate) height: usize,
    /// `[H, W, 3]`, in [0, 1].
    pub(crate) colors: Vec<f32>,
}

impl Picture {
    /// A picture of colors `[H, W, 3]` in [0, 1].
    ///
    /// # Errors
    /// No pixels or more than 2^28, another number of values, a value outside of [0, 1].
    pub fn new(width: usize, height: usize, colors: Vec<f32>) -> Result<Self, ImageError> {
        Window::whole(width, height).check()?;
        expect_len("picture", colors.len(), 3 * width * height)?;
        match colors.iter().find(|x| !(0.0..=1.0).contains(*x)) {
            Some(x) => Err(range("color of the picture", "a number from 0 to 1", x)),
            None => Ok(Self { width, height, colors }),
        }
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Colors `[H, W, 3]`.
    pub fn colors(&self) -> &[f32] {
        &self.colors
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// The number of Gaussians whose 56 bits each are a `ratio`-th of 24 bits a pixel, `floor(3 H W / (7 ratio))`, at
    /// least one.
    ///
    /// That is the published count. Coded as files, Gaussians take about half of these bits.
    pub fn gaussians_for(&self, ratio: f64) -> usize {
        (3.0 * self.pixels() as f64 / (7.0 * ratio)).floor().clamp(1.0, self.pixels() as f64) as usize
    }

    /// True if all pixels are the same.
    pub fn is_of_one_color(&self) -> bool {
        self.colors.chunks_exact(3).all(|pixel| *pixel == self.colors[..3])
    }

    pub(crate) fn window(&self) -> Window {
        Window::whole(self.width, self.height)
    }

    /// The picture at half the size: means of up to four pixels.
    pub(crate) fn half(&self) -> Self {
        let [width, height] = [self.width, self.height].map(|side| side.div_ceil(2));
        let mut colors = Vec::with_capacity(3 * width * height);
        for i in 0..width * height {
            let (x, y) = (2 * (i % width), 2 * (i / width));
            let (right, below) = ((x + 1).min(self.width - 1), (y + 1).min(self.height - 1));
            for c in 0..3 {
                let at = |x: usize, y: usize| self.colors[3 * (y * self.width + x) + c];
                colors.push(0.25 * ((at(x, y) + at(right, y)) + (at(x, below) + at(right, below))));
            }
        }
        Self { width, height, colors }
    }

    /// The color at a point by bilinear interpolation between pixel middles, clamped at the border.
    pub(crate) fn at(&self, x: f32, y: f32) -> [f32; 3] {
        let along = |at: f32, side: usize| {
            let at = (at - 0.5).clamp(0.0, (side - 1) as f32);
            (at as usize, (at as usize + 1).min(side - 1), at.fract())
        };
        let ((x0, x1, u), (y0, y1, v)) = (along(x, self.width), along(y, self.height));
        std::array::from_fn(|c| {
            let at = |x: usize, y: usize| self.colors[3 * (y * self.width + x) + c];
            let row = |y: usize| at(x0, y) + u * (at(x1, y) - at(x0, y));
            row(y0) + v * (row(y1) - row(y0))
        })
    }
}
