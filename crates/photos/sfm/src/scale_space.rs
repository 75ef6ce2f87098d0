//! A photo at growing blur: octaves of Gaussian images.

mod filters;

use filters::{blur, enlarged};
use weaver_kernels::pages;
use weaver_kernels::parallel::for_chunks;

/// Scales of an octave in which extrema are searched.
pub(crate) const SCALES: usize = 3;
/// Images of an octave.
pub(crate) const IMAGES: usize = SCALES + 3;
/// Blur of the first image of an octave, pixels of the octave, beyond the photo's own: photos that were shrunk have
/// little, and taking them for blurred costs a tenth of the pairs.
pub(crate) const SIGMA: f32 = 1.6;
/// Photos are enlarged by powers of two until their longer side is this long; all but large ones at least once, for
/// small detail: without it, three quarters of the matches are missing.
const LEAST_SIDE: usize = 512;
const LARGE: usize = 1024;
/// Octaves end where an image is smaller.
const SMALLEST: usize = 16;
/// Rows of a task.
const GRAIN: usize = 16;

/// A gray image, row by row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Image<'a> {
    pub width: usize,
    pub height: usize,
    pub values: &'a [f32],
}

impl<'a> Image<'a> {
    #[inline(always)]
    pub fn at(self, x: usize, y: usize) -> f32 {
        self.values[y * self.width + x]
    }

    #[inline(always)]
    pub fn row(self, y: usize) -> &'a [f32] {
        &self.values[y * self.width..][..self.width]
    }
}

/// Twice the gradients of an image, row by row: across and down.
#[derive(Debug, Default)]
pub(crate) struct Gradients {
    pub width: usize,
    pub height: usize,
    pub values: Vec<[f32; 2]>,
}

impl Gradients {
    /// Becomes the differences between the pixels to the right and left of each, and between the pixels below and
    /// above; one-sided at the border.
    pub fn set(&mut self, image: Image) {
        let (width, height) = (image.width, image.height);
        if self.values.len() < width * height {
            self.values = room(width * height);
        }
        self.values.truncate(width * height);
        (self.width, self.height) = (width, height);
        for_chunks(&mut self.values, GRAIN * width, |chunk, rows| {
            for (i, row) in rows.chunks_exact_mut(width).enumerate() {
                let y = chunk * GRAIN + i;
                let (above, below) = (image.row(y.saturating_sub(1)), image.row((y + 1).min(height - 1)));
                filters::gradients([above, image.row(y), below], row);
            }
        });
    }
}

/// Room for an image, in huge pages where it is large.
fn room<T: Copy + Default>(len: usize) -> Vec<T> {
    let mut room = vec![T::default(); len];
    pages::prefer_huge(&mut room);
    room
}

/// An octave: images of one size, whose blurs grow by 2^(1/3) from one to the next.
#[derive(Debug)]
pub(crate) struct Octave {
    pub width: usize,
    pub height: usize,
    /// [`IMAGES`] blurred images.
    values: Vec<f32>,
    /// Pixels of the photo from one pixel to the next.
    pub step: f64,
    /// Center of the first pixel, in pixels of the photo.
    pub origin: f64,
}

impl Octave {
    /// The first octave of a photo.
    fn first(photo: Image) -> Self {
        let side = photo.width.max(photo.height);
        let mut factor = if side < LARGE { 2 } else { 1 };
        while side * factor < LEAST_SIDE {
            factor *= 2;
        }
        let step = 1.0 / factor as f64;
        let mut octave = Self::new(factor * photo.width, factor * photo.height, step, 0.5 * step);
        let (first, rest) = octave.values.split_at_mut(octave.width * octave.height);
        let enlarged = enlarged(photo, factor, &mut rest[..first.len()]);
        blur(enlarged, SIGMA, first);
        octave.fill();
        octave
    }

    /// Every second pixel of every second row of the image that is blurred twice as much as the first, and the images
    /// that follow from it.
    fn next(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        // The first pixel stays where it is.
        let mut octave = Self::new(width, height, 2.0 * self.step, self.origin);
        let from = self.image(SCALES);
        for (y, row) in octave.values[..width * height].chunks_exact_mut(width).enumerate() {
            row.iter_mut().zip(from.row(2 * y).iter().step_by(2)).for_each(|(to, from)| *to = *from);
        }
        octave.fill();
        octave
    }

    fn new(width: usize, height: usize, step: f64, origin: f64) -> Self {
        Self { width, height, values: room(IMAGES * width * height), step, origin }
    }

    /// Makes all images from the first.
    fn fill(&mut self) {
        let (width, height) = (self.width, self.height);
        for i in 1..IMAGES {
            let sigma = |i: usize| SIGMA * 2.0_f32.powf(i as f32 / SCALES as f32);
            let more = (sigma(i).powi(2) - sigma(i - 1).powi(2)).sqrt();
            let (before, after) = self.values.split_at_mut(i * width * height);
            let values = &before[(i - 1) * width * height..];
            blur(Image { width, height, values }, more, &mut after[..width * height]);
        }
    }

    /// One of the images, the least blurred first.
    #[inline(always)]
    pub fn image(&self, number: usize) -> Image<'_> {
        let (width, height) = (self.width, self.height);
        Image { width, height, values: &self.values[number * width * height..][..width * height] }
    }

    /// The difference of an image and the one before it at a pixel.
    #[inline(always)]
    pub fn difference(&self, number: usize, x: usize, y: usize) -> f32 {
        self.image(number + 1).at(x, y) - self.image(number).at(x, y)
    }
}

/// The octaves of a photo. Source: Lowe, Distinctive image features from scale-invariant keypoints, 2004, section 3.
pub(crate) fn octaves(photo: Image) -> Vec<Octave> {
    let mut octaves = vec![Octave::first(photo)];
    while let Some(last) = octaves.last().filter(|o| o.width.min(o.height).div_ceil(2) >= SMALLEST) {
        let next = last.next();
        octaves.push(next);
    }
    octaves
}
