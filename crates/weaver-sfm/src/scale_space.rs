//! A photo at growing blur: octaves of Gaussian images and their differences.

use weaver_kernels::lanes::{self, LaneKernel, Lanes};
use weaver_kernels::parallel::{for_chunks, for_chunks2};

/// Scales of an octave in which extrema are looked for.
pub(crate) const SCALES: usize = 3;
/// Blur of the first image of an octave, pixels of the octave, beyond what the photo has: photos that were shrunk have
/// little, and taking them for blurred costs a tenth of the pairs.
pub(crate) const SIGMA: f32 = 1.6;
/// Photos are enlarged by powers of two until their longer side is this long; all but large ones once at least, for the sake of
/// small detail.
const LEAST_SIDE: usize = 512;
const LARGE: usize = 1024;
/// Octaves end where an image is smaller.
const SMALLEST: usize = 16;
/// Where a Gaussian ends, in its deviations.
const REACH: f32 = 3.0;
/// Rows of a task.
const GRAIN: usize = 16;

/// A gray image, row by row.
#[derive(Clone, Debug, Default)]
pub(crate) struct Gray {
    pub width: usize,
    pub height: usize,
    pub values: Vec<f32>,
}

impl Gray {
    #[inline]
    pub fn at(&self, x: usize, y: usize) -> f32 {
        self.values[y * self.width + x]
    }

    #[inline(always)]
    pub fn row(&self, y: usize) -> &[f32] {
        &self.values[y * self.width..][..self.width]
    }

    /// Makes room for an image of another's size, with any content.
    fn fit(&mut self, other: &Self) {
        (self.width, self.height) = (other.width, other.height);
        self.values.resize(other.values.len(), 0.0);
    }

    /// Enlarged by a whole factor, by cubic splines through pixel centers (Keys, 1981).
    fn enlarged(&self, factor: usize) -> Self {
        let (width, height) = (self.width * factor, self.height * factor);
        let taps: Vec<(isize, [f32; 4])> = (0..factor).map(|i| spline(i, factor)).collect();
        let mut values = vec![0.0; width * height];
        for_chunks(&mut values, factor * width, |y, rows| {
            let mut padded = vec![0.0; self.width + 2 * MARGIN];
            let mut phases = vec![0.0; self.width];
            for (row, (first, weights)) in rows.chunks_exact_mut(width).zip(&taps) {
                let line = |k: usize| {
                    let y = y as isize + first + k as isize;
                    self.row(y.clamp(0, self.height as isize - 1) as usize)
                };
                let lines = [line(0), line(1), line(2), line(3)];
                lanes::run(Weighted { rows: lines, weights, out: &mut padded[MARGIN..][..self.width] });
                let (start, end) = (padded[MARGIN], padded[MARGIN + self.width - 1]);
                padded[..MARGIN].fill(start);
                padded[MARGIN + self.width..].fill(end);
                for (phase, (first, weights)) in taps.iter().enumerate() {
                    let shifted = |k: usize| &padded[(MARGIN as isize + first) as usize + k..][..self.width];
                    let rows = [shifted(0), shifted(1), shifted(2), shifted(3)];
                    lanes::run(Weighted { rows, weights, out: &mut phases });
                    row[phase..].iter_mut().step_by(factor).zip(&phases).for_each(|(to, from)| *to = *from);
                }
            }
        });
        Self { width, height, values }
    }

    /// Every second pixel of every second row.
    fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut values = Vec::with_capacity(width * height);
        for y in 0..height {
            values.extend(self.row(2 * y).iter().step_by(2));
        }
        Self { width, height, values }
    }

    /// Blurs the image by a Gaussian of this deviation; beyond the border lies its last pixel. `more` becomes what was added.
    fn blur(&self, sigma: f32, blurred: &mut Self, more: Option<&mut Self>) {
        let width = self.width;
        let radius = (REACH * sigma).ceil().max(1.0) as usize;
        let mut taps: Vec<f32> = (0..=radius).map(|i| (-0.5 * (i as f32 / sigma).powi(2)).exp()).collect();
        let sum = taps[0] + 2.0 * taps[1..].iter().sum::<f32>();
        taps.iter_mut().for_each(|t| *t /= sum);
        blurred.fit(self);
        let rows = |chunk: usize, blurred: &mut [f32], mut more: Option<&mut [f32]>| {
            let mut padded = vec![0.0; width + 2 * radius];
            for (i, blurred) in blurred.chunks_exact_mut(width).enumerate() {
                let y = chunk * GRAIN + i;
                let more = more.as_mut().map(|m| &mut m[i * width..][..width]);
                lanes::run(Blur { image: self, y, taps: &taps, padded: &mut padded, blurred, more });
            }
        };
        match more {
            Some(more) => {
                more.fit(self);
                for_chunks2(
                    &mut blurred.values,
                    GRAIN * width,
                    &mut more.values,
                    GRAIN * width,
                    |chunk, blurred, more| rows(chunk, blurred, Some(more)),
                );
            }
            None => for_chunks(&mut blurred.values, GRAIN * width, |chunk, blurred| rows(chunk, blurred, None)),
        }
    }

    /// The differences of the pixels to the right and left of each, and of those below and above; at the border, of what
    /// there is.
    pub fn gradients(&self) -> Gradients {
        let (width, height) = (self.width, self.height);
        let mut values = vec![[0.0; 2]; width * height];
        for_chunks(&mut values, GRAIN * width, |chunk, rows| {
            for (i, row) in rows.chunks_exact_mut(width).enumerate() {
                let y = chunk * GRAIN + i;
                let (above, here, below) =
                    (self.row(y.saturating_sub(1)), self.row(y), self.row((y + 1).min(height - 1)));
                weaver_kernels::simd::dispatch(
                    #[inline(always)]
                    || {
                        let inner = row[1..width - 1].iter_mut().zip(&here[2..]).zip(&here[..width - 2]);
                        for (((to, right), left), (below, above)) in inner.zip(below[1..].iter().zip(&above[1..])) {
                            *to = [right - left, below - above];
                        }
                    },
                );
                for (x, left, right) in [(0, 0, 1), (width - 1, width - 2, width - 1)] {
                    row[x] = [here[right] - here[left], below[x] - above[x]];
                }
            }
        });
        Gradients { width, height, values }
    }
}

/// Twice the gradients of an image, row by row: across and down.
#[derive(Debug)]
pub(crate) struct Gradients {
    pub width: usize,
    pub height: usize,
    pub values: Vec<[f32; 2]>,
}

/// Pixels that a spline reaches beyond the border.
const MARGIN: usize = 2;

/// The first pixel, from that of the same number on, and the weights of four that give pixel `i` of `factor` to a pixel.
fn spline(i: usize, factor: usize) -> (isize, [f32; 4]) {
    let at = (i as f32 + 0.5) / factor as f32 - 0.5;
    let t = at - at.floor();
    let weight = |d: f32| match d.abs() {
        d if d < 1.0 => (1.5 * d - 2.5) * d * d + 1.0,
        d => ((-0.5 * d + 2.5) * d - 4.0) * d + 2.0,
    };
    (at.floor() as isize - 1, std::array::from_fn(|k| weight(t + 1.0 - k as f32)))
}

/// A weighted sum of four rows.
struct Weighted<'a> {
    rows: [&'a [f32]; 4],
    weights: &'a [f32; 4],
    out: &'a mut [f32],
}

impl LaneKernel<f32> for Weighted<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lanes<Scalar = f32>>(self) {
        let weights = self.weights.map(V::splat);
        lanes::map(
            self.rows,
            self.out,
            #[inline(always)]
            |[a, b, c, d]: [V; 4], _| {
                let outer = a.mul_add(weights[0], d * weights[3]);
                b.mul_add(weights[1], c.mul_add(weights[2], outer))
            },
        );
    }
}

/// A row of a blurred image: down first, then across, while it is in the cache.
struct Blur<'a> {
    image: &'a Gray,
    y: usize,
    /// The weight of the pixel itself and those of its neighbors on either side.
    taps: &'a [f32],
    padded: &'a mut [f32],
    blurred: &'a mut [f32],
    more: Option<&'a mut [f32]>,
}

impl LaneKernel<f32> for Blur<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lanes<Scalar = f32>>(self) {
        let Self { image, y, taps, padded, blurred, more } = self;
        let (radius, width) = (taps.len() - 1, image.width);
        let mut lines = [(&[][..], &[][..]); 32];
        for (d, pair) in lines[..=radius].iter_mut().enumerate() {
            *pair = (image.row(y.saturating_sub(d)), image.row((y + d).min(image.height - 1)));
        }
        let inner = &mut padded[radius..][..width];
        for x in (0..width).step_by(lanes::LANES) {
            let mut sum = lanes::at::<V>(lines[0].0, x) * V::splat(taps[0]);
            for (tap, (above, below)) in taps[1..].iter().zip(&lines[1..]) {
                let both = lanes::at::<V>(above, x) + lanes::at::<V>(below, x);
                sum = both.mul_add(V::splat(*tap), sum);
            }
            lanes::put(sum, inner, x);
        }
        let (start, end) = (padded[radius], padded[radius + width - 1]);
        padded[..radius].fill(start);
        padded[radius + width..].fill(end);
        for x in (0..width).step_by(lanes::LANES) {
            let mut sum = lanes::at::<V>(padded, radius + x) * V::splat(taps[0]);
            for (d, tap) in taps.iter().enumerate().skip(1) {
                let both = lanes::at::<V>(padded, radius + x - d) + lanes::at::<V>(padded, radius + x + d);
                sum = both.mul_add(V::splat(*tap), sum);
            }
            lanes::put(sum, blurred, x);
        }
        if let Some(more) = more {
            let before = image.row(y);
            lanes::map(
                [before, blurred],
                more,
                #[inline(always)]
                |[before, after]: [V; 2], _| after - before,
            );
        }
    }
}

/// An octave: images of one size, whose blurs grow by 2^(1/3) from one to the next.
#[derive(Debug)]
pub(crate) struct Octave {
    /// `SCALES + 3` blurred images.
    pub images: Vec<Gray>,
    /// The differences of neighbors among them.
    pub differences: Vec<Gray>,
    /// Pixels of the photo from one pixel to the next.
    pub step: f64,
    /// Where the center of the first pixel lies, pixels of the photo.
    pub origin: f64,
}

impl Octave {
    /// The first octave of a photo. Source: Lowe, Distinctive image features from scale-invariant keypoints, 2004, section 3.
    pub fn first(photo: Gray) -> Self {
        let side = photo.width.max(photo.height);
        let mut factor = if side < LARGE { 2 } else { 1 };
        while side * factor < LEAST_SIDE {
            factor *= 2;
        }
        if let Ok(f) = std::env::var("FACTOR") { factor = f.parse().unwrap(); }
        let photo = if factor > 1 { photo.enlarged(factor) } else { photo };
        let step = 1.0 / factor as f64;
        let mut images = vec![Gray::default(); SCALES + 3];
        photo.blur(SIGMA, &mut images[0], None);
        let mut octave = Self { images, differences: vec![Gray::default(); SCALES + 2], step, origin: 0.5 * step };
        octave.fill();
        octave
    }

    /// The next octave in place of this; false if it would be too small.
    pub fn next(&mut self) -> bool {
        self.images[0] = self.images[SCALES].halved();
        // The first pixel stays where it is.
        self.step *= 2.0;
        let large = self.images[0].width.min(self.images[0].height) >= SMALLEST;
        if large {
            self.fill();
        }
        large
    }

    /// Makes all images from the first.
    fn fill(&mut self) {
        for i in 1..SCALES + 3 {
            let blur = |i: usize| SIGMA * 2.0_f32.powf(i as f32 / SCALES as f32);
            let more = (blur(i).powi(2) - blur(i - 1).powi(2)).sqrt();
            let (before, after) = self.images.split_at_mut(i);
            before[i - 1].blur(more, &mut after[0], Some(&mut self.differences[i - 1]));
        }
    }
}
