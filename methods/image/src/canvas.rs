//! Drawing of a window and its gradients, tile by tile.

use crate::error::{ImageError, expect_len};
use crate::gaussians::Gaussians;
use crate::lists::{Lists, over};
use crate::passes::{Count, Draw, Rays, Step, Transposed};
use crate::record::{K, exponent, record};
use crate::tile::{SHAPE, SUMS, Sums};
use crate::window::{Tiled, Window};
use rayon::prelude::*;
use weaver_kernels::lanes::{self, Row};
use weaver_kernels::{Real, parallel};

/// Standard deviations at which Gaussians end.
pub const CUT: f64 = 3.0;

/// Gaussians of a parallel task.
const GRAIN: usize = 128;

/// A window onto placed Gaussians: draws colors, and passes gradients back.
///
/// The window is cut into tiles of 16 x 16 pixels. A Gaussian is in the list of a tile if the box of its ellipse at the
/// cut meets it, and 0 beyond that ellipse. A pixel adds Gaussians in their order in every window, so that a region has
/// the bits of the whole. The same bits at any number of threads. A repeated call allocates nothing but the values of
/// one tile per task.
///
/// ```
/// use weaver_image::{CUT, Canvas, Gaussians, Window};
/// let mut picture = Gaussians::default();
/// picture.push([8.5, 8.5], [2.0, 1.0], 0.3, [1.0_f32, 0.5, 0.0]);
/// let mut canvas = Canvas::new();
/// canvas.place(&picture, Window::whole(20, 20), CUT)?;
/// let mut image = vec![0.0; 20 * 20 * 3];
/// canvas.draw(&picture.colors, &mut image)?;
/// assert_eq!(image[3 * (8 * 20 + 8)..][..3], [1.0, 0.5, 0.0]);
/// # Ok::<(), weaver_image::ImageError>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct Canvas<T> {
    window: Option<Window>,
    cut: f64,
    records: Vec<Row<T>>,
    lists: Lists,
    /// Sums of each entry of the lists.
    sums: Vec<Sums<T>>,
    /// Sums of each Gaussian.
    rows: Vec<Sums<T>>,
}

impl<T: Real> Canvas<T> {
    /// A canvas without memory.
    pub fn new() -> Self {
        Self::default()
    }

    /// Places Gaussians, without their colors. `cut` is in standard deviations, at most 12.
    ///
    /// # Errors
    /// Gaussians that [`Gaussians::check`] refuses, a window without pixels or beyond 2^28, too many tiles under
    /// Gaussians.
    pub fn place(&mut self, gaussians: &Gaussians<T>, window: Window, cut: f64) -> Result<(), ImageError> {
        gaussians.check()?;
        window.check()?;
        if !(cut > 0.0 && cut <= 12.0) {
            return Err(crate::error::range("cut", "above 0 and at most 12 standard deviations", cut));
        }
        self.cut = cut;
        self.window = Some(window);
        self.records.resize(gaussians.len(), Row([T::ZERO; 16]));
        self.lists.boxes.resize(gaussians.len(), [0; 4]);
        let boxes = &mut self.lists.boxes;
        parallel::for_chunks2(&mut self.records, GRAIN, boxes, GRAIN, |chunk, rows, boxes| {
            for ((row, tiles), i) in rows.iter_mut().zip(boxes).zip(chunk * GRAIN..) {
                let (numbers, half) = record(gaussians, i);
                let center = [gaussians.centers[2 * i], gaussians.centers[2 * i + 1]].map(|x| x.to_f64());
                (*row, *tiles) = (numbers, over(&window, center, half.map(|side| cut * side)));
            }
        });
        self.lists.fill(&window)
    }

    /// N, the number of Gaussians.
    pub(crate) fn len(&self) -> usize {
        self.records.len()
    }

    /// The window, empty before the first placement.
    fn window(&self) -> Window {
        self.window.unwrap_or(Window::whole(0, 0))
    }

    /// Entries of the lists of all tiles.
    pub fn entries(&self) -> usize {
        self.lists.entries.len()
    }

    /// Pairs of a Gaussian and a block of 16 pixels in its footprint; the operations of a drawing are proportional to
    /// them.
    pub fn blocks(&self) -> u64 {
        let rays = self.rays();
        (0..self.lists.tiles[1]).into_par_iter().map(|band| lanes::run(Count { rays, band })).sum()
    }

    fn rays(&self) -> Rays<'_, T> {
        let cut = T::from_f64(exponent(self.cut));
        Rays { window: self.window(), lists: &self.lists, records: &self.records, cut }
    }

    /// Draws colors `[N, C]` to an image `[H, W, C]`, C = 1 or 3; overwrites it. Not clamped.
    ///
    /// # Errors
    /// Lengths that fit neither one channel nor three.
    pub fn draw(&self, colors: &[T], image: &mut [T]) -> Result<(), ImageError> {
        let channels = self.channels(colors.len(), image.len())?;
        let rays = self.rays();
        let bands = self.window().bands(image, channels).into_par_iter().enumerate();
        bands.for_each(|(band, lines)| match channels {
            1 => lanes::run(Draw::<_, 1> { rays, band, colors, lines }),
            _ => lanes::run(Draw::<_, 3> { rays, band, colors, lines }),
        });
        Ok(())
    }

    /// Adds to colors `[N, C]` the transpose of [`draw`](Self::draw) applied to an image `[H, W, C]`: the gradient with
    /// respect to colors.
    ///
    /// # Errors
    /// As [`draw`](Self::draw).
    pub fn transposed(&mut self, image: &[T], colors: &mut [T]) -> Result<(), ImageError> {
        let channels = self.channels(colors.len(), image.len())?;
        match channels {
            1 => self.back::<1, false>(&[], image),
            _ => self.back::<3, false>(&[], image),
        }
        for (row, sums) in colors.chunks_exact_mut(channels).zip(&self.rows) {
            row.iter_mut().zip(sums).for_each(|(to, sum)| *to += *sum);
        }
        Ok(())
    }

    /// Overwrites `gradient` by the gradient of a loss with respect to the placed Gaussians, given `slopes`
    /// `[H, W, 3]`, its gradient with respect to the image.
    ///
    /// With `t = w sum_ch g c` and `u = R^T d`: centers `sum t S^-1 d`, scales `sum t u_k^2 / s_k^3`, angles
    /// `sum t u_1 u_2 (1/s_2^2 - 1/s_1^2)`, colors `sum w g`. The cut is constant.
    ///
    /// # Errors
    /// Another number of Gaussians than was placed, or an image of another size.
    pub fn backward(
        &mut self,
        gaussians: &Gaussians<T>,
        slopes: &[T],
        gradient: &mut Gaussians<T>,
    ) -> Result<(), ImageError> {
        expect_len("colors of Gaussians", gaussians.colors.len(), 3 * self.records.len())?;
        expect_len("gradient of the image", slopes.len(), 3 * self.window().pixels())?;
        self.back::<3, true>(&gaussians.colors, slopes);
        self.pass_on(gaussians, 1.0, gradient);
        Ok(())
    }

    /// The mean squared error of the drawing, not clamped, against a picture, and its gradient, without an image in
    /// between.
    ///
    /// # Errors
    /// Another number of Gaussians than was placed, or a window of another size than the picture's.
    pub fn squared_error(
        &mut self,
        gaussians: &Gaussians<T>,
        target: &Tiled<T>,
        gradient: &mut Gaussians<T>,
    ) -> Result<f64, ImageError> {
        expect_len("colors of Gaussians", gaussians.colors.len(), 3 * self.records.len())?;
        expect_len("tiles of the picture", target.tiles.len(), self.lists.tiles.iter().product())?;
        let mut sums = std::mem::take(&mut self.sums);
        sums.resize(self.entries(), [T::ZERO; SUMS]);
        let rays = self.rays();
        let bands = bands(&self.lists, &mut sums).into_par_iter().enumerate();
        let errors: Vec<f64> = bands
            .map(|(band, sums)| lanes::run(Step { rays, band, colors: &gaussians.colors, target, sums }))
            .collect();
        self.sums = sums;
        self.gather();
        let count = (3 * self.window().pixels()) as f64;
        self.pass_on(gaussians, 2.0 / count, gradient);
        Ok(errors.iter().sum::<f64>() / count)
    }

    fn channels(&self, colors: usize, image: usize) -> Result<usize, ImageError> {
        let pixels = self.window().pixels();
        let channels = if image == pixels { 1 } else { 3 };
        expect_len("image", image, channels * pixels)?;
        expect_len("colors of Gaussians", colors, channels * self.records.len())?;
        Ok(channels)
    }

    /// Leaves sums of each Gaussian in `rows`.
    fn back<const C: usize, const MOVE: bool>(&mut self, colors: &[T], slopes: &[T]) {
        let mut sums = std::mem::take(&mut self.sums);
        sums.resize(self.entries(), [T::ZERO; SUMS]);
        let rays = self.rays();
        let bands = bands(&self.lists, &mut sums).into_par_iter().enumerate();
        bands.for_each(|(band, sums)| lanes::run(Transposed::<_, C, MOVE> { rays, band, colors, slopes, sums }));
        self.sums = sums;
        self.gather();
    }

    /// Adds the sums of each Gaussian's entries.
    fn gather(&mut self) {
        let (lists, sums) = (&self.lists, &self.sums);
        self.rows.resize(self.records.len(), [T::ZERO; SUMS]);
        parallel::for_chunks(&mut self.rows, GRAIN, |chunk, rows| {
            for (i, row) in rows.iter_mut().enumerate() {
                *row = [T::ZERO; SUMS];
                for place in lists.of_gaussian(chunk * GRAIN + i) {
                    row.iter_mut().zip(&sums[*place as usize]).for_each(|(to, x)| *to += *x);
                }
            }
        });
    }

    /// Turns the sums of each Gaussian into gradients, times a factor.
    fn pass_on(&mut self, gaussians: &Gaussians<T>, factor: f64, gradient: &mut Gaussians<T>) {
        parallel::for_chunks(&mut self.rows, GRAIN, |chunk, rows| {
            let all = rows.iter_mut().enumerate();
            all.for_each(|(i, row)| *row = chain(gaussians, chunk * GRAIN + i, row, factor));
        });
        let count = self.rows.len();
        gradient.colors.resize(3 * count, T::ZERO);
        gradient.centers.resize(2 * count, T::ZERO);
        gradient.scales.resize(2 * count, T::ZERO);
        gradient.angles.resize(count, T::ZERO);
        for (i, row) in self.rows.iter().enumerate() {
            gradient.colors[3 * i..3 * i + 3].copy_from_slice(&row[..SHAPE]);
            gradient.centers[2 * i..2 * i + 2].copy_from_slice(&row[3..5]);
            gradient.scales[2 * i..2 * i + 2].copy_from_slice(&row[5..7]);
            gradient.angles[i] = row[7];
        }
    }
}

/// Gradients with respect to color, center, scale and angle, from sums over pixels.
///
/// `(u, v)` of the sums, over the root of K, and the offset along the axes in standard deviations differ by a rotation,
/// (m, n).
fn chain<T: Real>(gaussians: &Gaussians<T>, i: usize, sums: &Sums<T>, factor: f64) -> Sums<T> {
    let [r, g, b, u, v, uu, uv, vv] = sums.map(|x| factor * x.to_f64());
    let [s1, s2] = [gaussians.scales[2 * i], gaussians.scales[2 * i + 1]].map(|s| s.to_f64());
    let (sin, cos) = gaussians.angles[i].to_f64().sin_cos();
    let length = (cos / s1).hypot(sin / s2);
    let (m, n) = (cos / s1 / length, -sin / s2 / length);
    let root = K.sqrt();
    let (along, across) = ((m * u - n * v) / (root * s1), (n * u + m * v) / (root * s2));
    let center = [cos * along - sin * across, sin * along + cos * across];
    let twice = 2.0 * m * n * uv;
    let scale = [(m * m * uu - twice + n * n * vv) / (K * s1), (n * n * uu + twice + m * m * vv) / (K * s2)];
    let angle = (m * n * (uu - vv) + (m * m - n * n) * uv) / K * (s1 / s2 - s2 / s1);
    [r, g, b, center[0], center[1], scale[0], scale[1], angle].map(T::from_f64)
}

/// Sums of entries, for each row of tiles.
fn bands<'a, T>(lists: &Lists, mut sums: &'a mut [Sums<T>]) -> Vec<&'a mut [Sums<T>]> {
    let split = |band| {
        let (own, rest) = std::mem::take(&mut sums).split_at_mut(lists.of_band(band).len());
        sums = rest;
        own
    };
    (0..lists.tiles[1]).map(split).collect()
}
