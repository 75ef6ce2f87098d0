//! A photo at growing blur: octaves of Gaussian images and their differences.

use weaver_kernels::parallel;

/// Scales of an octave in which extrema are looked for.
pub(crate) const SCALES: usize = 3;
/// Blur of the first image of an octave, pixels of the octave, beyond what the photo has: photos that were shrunk have
/// little, and taking them for blurred costs a tenth of the pairs.
pub(crate) const SIGMA: f32 = 1.6;
/// Photos are enlarged by powers of two until they are this wide; all but large ones once at least, for the sake of
/// small detail.
const LEAST_WIDTH: usize = 512;
const LARGE: usize = 1024;
/// Octaves end where an image is smaller.
const LEAST_SIDE: usize = 16;
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

    /// Enlarged by a whole factor, by cubic splines through pixel centers (Keys, 1981).
    fn enlarged(&self, factor: usize) -> Self {
        let (width, height) = (self.width * factor, self.height * factor);
        // The first of four pixels and their weights, the same for all lines.
        let taps = |size: usize| -> Vec<([usize; 4], [f32; 4])> {
            let of = |i: usize| {
                let at = (i as f32 + 0.5) / factor as f32 - 0.5;
                let (low, t) = (at.floor(), at - at.floor());
                let pixel = |k: usize| (low as isize + k as isize - 1).clamp(0, size as isize - 1) as usize;
                let weight = |d: f32| match d.abs() {
                    d if d < 1.0 => (1.5 * d - 2.5) * d * d + 1.0,
                    d => ((-0.5 * d + 2.5) * d - 4.0) * d + 2.0,
                };
                (std::array::from_fn(pixel), std::array::from_fn(|k| weight(t + 1.0 - k as f32)))
            };
            (0..factor * size).map(of).collect()
        };
        let (columns, rows) = (taps(self.width), taps(self.height));
        let mut across = vec![0.0; width * self.height];
        parallel::for_chunks(&mut across, width, |y, row| {
            for (value, (pixels, weights)) in row.iter_mut().zip(&columns) {
                *value = (0..4).map(|k| weights[k] * self.at(pixels[k], y)).sum();
            }
        });
        let mut values = vec![0.0; width * height];
        parallel::for_chunks(&mut values, width, |y, row| {
            let (lines, weights) = &rows[y];
            for (x, value) in row.iter_mut().enumerate() {
                *value = (0..4).map(|k| weights[k] * across[lines[k] * width + x]).sum();
            }
        });
        Self { width, height, values }
    }

    /// Every second pixel of every second row.
    fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let values = (0..width * height).map(|i| self.at(2 * (i % width), 2 * (i / width))).collect();
        Self { width, height, values }
    }

    /// Blurred by a Gaussian of this deviation; beyond the border lies its last pixel.
    fn blurred(&self, sigma: f32) -> Self {
        let (width, height) = (self.width, self.height);
        let radius = (4.0 * sigma).ceil().max(1.0) as usize;
        let mut taps: Vec<f32> = (0..=radius).map(|i| (-0.5 * (i as f32 / sigma).powi(2)).exp()).collect();
        let sum = taps[0] + 2.0 * taps[1..].iter().sum::<f32>();
        taps.iter_mut().for_each(|t| *t /= sum);
        let mut across = vec![0.0; width * height];
        parallel::for_chunks(&mut across, GRAIN * width, |chunk, rows| {
            let mut padded = vec![0.0; width + 2 * radius];
            for (i, row) in rows.chunks_exact_mut(width).enumerate() {
                let from = &self.values[(chunk * GRAIN + i) * width..][..width];
                padded[..radius].fill(from[0]);
                padded[radius..][..width].copy_from_slice(from);
                padded[radius + width..].fill(from[width - 1]);
                row.iter_mut().zip(&padded[radius..]).for_each(|(r, p)| *r = taps[0] * p);
                for (d, tap) in taps.iter().enumerate().skip(1) {
                    let sides = padded[radius - d..].iter().zip(&padded[radius + d..]);
                    row.iter_mut().zip(sides).for_each(|(r, (a, b))| *r += tap * (a + b));
                }
            }
        });
        let mut values = vec![0.0; width * height];
        parallel::for_chunks(&mut values, GRAIN * width, |chunk, rows| {
            for (i, row) in rows.chunks_exact_mut(width).enumerate() {
                let y = chunk * GRAIN + i;
                let line = |y: usize| &across[y.min(height - 1) * width..][..width];
                row.iter_mut().zip(line(y)).for_each(|(r, p)| *r = taps[0] * p);
                for (d, tap) in taps.iter().enumerate().skip(1) {
                    let sides = line(y.saturating_sub(d)).iter().zip(line(y + d));
                    row.iter_mut().zip(sides).for_each(|(r, (a, b))| *r += tap * (a + b));
                }
            }
        });
        Self { width, height, values }
    }

    fn less(&self, other: &Self) -> Self {
        let values = self.values.iter().zip(&other.values).map(|(a, b)| a - b).collect();
        Self { values, ..*self }
    }
}

/// Images of one size: blurs grow by 2^(1/3) from one to the next.
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

/// The octaves of a photo `[H, W]`. Source: Lowe, Distinctive image features from scale-invariant keypoints, 2004, section 3.
pub(crate) fn octaves(photo: Gray) -> Vec<Octave> {
    let mut factor = if photo.width < LARGE { 2 } else { 1 };
    while photo.width * factor < LEAST_WIDTH {
        factor *= 2;
    }
    let mut base = if factor > 1 { photo.enlarged(factor) } else { photo };
    base = base.blurred(SIGMA);
    let mut step = 1.0 / factor as f64;
    let origin = 0.5 * step;
    let mut octaves = Vec::new();
    while base.width.min(base.height) >= LEAST_SIDE {
        let mut images = vec![base];
        for i in 1..SCALES + 3 {
            let blur = |i: usize| SIGMA * 2.0_f32.powf(i as f32 / SCALES as f32);
            let more = (blur(i).powi(2) - blur(i - 1).powi(2)).sqrt();
            let next = images[i - 1].blurred(more);
            images.push(next);
        }
        let differences = images.windows(2).map(|pair| pair[1].less(&pair[0])).collect();
        base = images[SCALES].halved();
        octaves.push(Octave { images, differences, step, origin });
        step *= 2.0;
    }
    octaves
}
