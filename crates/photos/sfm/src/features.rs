//! Keypoints and their descriptors.

use crate::descriptor::{DESCRIPTOR, Place, describe, orientations};
use crate::scale_space::{Gradients, IMAGES, Image, Octave, SCALES, SIGMA, octaves};
use weaver_geometry::glam::{DVec2, Mat3, Vec2, Vec3};
use weaver_kernels::lanes::{self, LANES, LaneKernel, LaneMask, Lanes};
use weaver_kernels::parallel;

/// Least contrast of a keypoint in a photo from 0 to 1, over the scales of an octave.
const CONTRAST: f32 = 0.01;
/// Largest ratio of the two curvatures of a keypoint: along an edge a place is undetermined.
const EDGE: f32 = 12.0;
/// Pixels at the border in which there are no keypoints.
const BORDER: usize = 5;
/// Largest distance of a keypoint from its pixel, in pixels and scales: more than half, so that a keypoint in the
/// middle of two does not oscillate.
const NEAR: f32 = 0.6;
/// Moves of a keypoint to the neighboring pixel while it is refined.
const MOVES: usize = 5;
/// Keypoints or rows of a task.
const GRAIN: usize = 16;
/// Pixels of a vector and its neighbors.
const WINDOW: usize = LANES + 2;

/// A place that can be found again in other photos.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keypoint {
    /// Its place, pixels; centers of pixels are at .5.
    pub pixel: DVec2,
    /// Deviation of the Gaussian that it was found with, pixels.
    pub scale: f64,
    /// Its direction, radians from x to y.
    pub angle: f32,
    /// Contrast against its surroundings.
    pub contrast: f32,
}

/// A photo in sRGB `[height, width, 3]` in gray, from 0 to 1: the mean of its colors.
pub(crate) fn gray(rgb: &[u8]) -> Vec<f32> {
    rgb.chunks_exact(3).map(|c| c.iter().map(|c| f32::from(*c)).sum::<f32>() / 765.0).collect()
}

/// The keypoints of a photo, with their descriptors.
#[derive(Clone, Debug, Default)]
pub struct Features {
    /// `N` keypoints by falling contrast.
    pub keypoints: Vec<Keypoint>,
    /// `[N, 128]`: square roots of normalized histograms, in whole numbers up to 127. Lengths are 250 up to rounding,
    /// so that the product of two has 16 bits.
    pub descriptors: Vec<u8>,
}

/// An extremum of the differences of blurred images.
#[derive(Clone, Copy, Debug)]
struct Extremum {
    /// Its place in its image.
    place: Place,
    /// The image whose blur is nearest to its scale, over all octaves.
    image: usize,
    /// Its place in the photo, and its scale there.
    pixel: DVec2,
    scale: f64,
    contrast: f32,
    /// Number of extrema with more contrast.
    rank: usize,
}

impl Features {
    /// SIFT features of a gray photo `[height, width]` from 0 to 1, at most `most` of them: extrema of differences of
    /// Gaussians with histograms of gradients, whose square roots are compared.
    ///
    /// Small photos are enlarged first. Where `mask` `[height, width]` is false there are none. The same at any number
    /// of threads.
    ///
    /// Sources: Lowe, Distinctive image features from scale-invariant keypoints, 2004; Arandjelovic and Zisserman,
    /// Three things everyone should know to improve object retrieval, 2012, for the square roots.
    ///
    /// ```
    /// use weaver_sfm::Features;
    /// let dots = |x: f32, y: f32| (x * 0.7).sin() * (y * 0.5).cos() * 0.5 + 0.5;
    /// let photo: Vec<f32> = (0..64 * 48).map(|i| dots((i % 64) as f32, (i / 64) as f32)).collect();
    /// let features = Features::new(&photo, [48, 64], None, 500);
    /// assert!(!features.keypoints.is_empty());
    /// assert_eq!(features.descriptors.len(), 128 * features.keypoints.len());
    /// ```
    ///
    /// # Panics
    /// If `gray` (or `mask`) is not as large as `size` says.
    pub fn new(gray: &[f32], size: [usize; 2], mask: Option<&[bool]>, most: usize) -> Self {
        let [height, width] = size;
        assert_eq!(gray.len(), width * height, "features: a photo of {width}x{height}");
        assert!(mask.is_none_or(|m| m.len() == gray.len()), "features: a mask of {width}x{height}");
        if width.min(height) < 8 {
            return Self::default();
        }
        let octaves = octaves(Image { width, height, values: gray });
        let all = octaves.iter().enumerate().flat_map(|(number, octave)| extrema(octave, number * SCALES));
        let mut extrema: Vec<Extremum> = match mask {
            Some(mask) => all.filter(|e| mask[pixel(e.pixel.y, height) * width + pixel(e.pixel.x, width)]).collect(),
            None => all.collect(),
        };
        let mut order: Vec<usize> = (0..extrema.len()).collect();
        order.sort_by(|a, b| extrema[*b].contrast.total_cmp(&extrema[*a].contrast));
        order.iter().take(most).enumerate().for_each(|(rank, i)| extrema[*i].rank = rank);
        extrema.retain(|e| e.rank < most);
        extrema.sort_by_key(|e| e.image);
        let mut found: Vec<Vec<(Keypoint, [u8; DESCRIPTOR])>> = vec![Vec::new(); extrema.len()];
        // One image after the other, and each row by row, so that reads lie close together.
        let mut gradients = Gradients::default();
        let mut rest = &mut found[..];
        for extrema in extrema.chunk_by(|a, b| a.image == b.image) {
            let image = extrema[0].image;
            gradients.set(octaves[image / SCALES].image(1 + image % SCALES));
            let found = rest.split_off_mut(..extrema.len()).expect("as many as extrema");
            parallel::for_chunks(found, GRAIN, |chunk, found| {
                for (found, e) in found.iter_mut().zip(&extrema[chunk * GRAIN..]) {
                    for angle in orientations(&gradients, e.place) {
                        let keypoint = Keypoint { pixel: e.pixel, scale: e.scale, angle, contrast: e.contrast };
                        found.push((keypoint, describe(&gradients, e.place, angle)));
                    }
                }
            });
        }
        let mut ranked = vec![0; extrema.len()];
        extrema.iter().enumerate().for_each(|(i, e)| ranked[e.rank] = i);
        let count = found.iter().map(Vec::len).sum::<usize>().min(most);
        let mut features =
            Self { keypoints: Vec::with_capacity(count), descriptors: Vec::with_capacity(DESCRIPTOR * count) };
        for (keypoint, descriptor) in ranked.into_iter().flat_map(|i| &found[i]).take(most) {
            features.keypoints.push(*keypoint);
            features.descriptors.extend(descriptor);
        }
        features
    }

    /// The keypoints with the largest scales, which are found again from farther away.
    pub(crate) fn largest(&self, most: usize) -> Self {
        let mut order: Vec<usize> = (0..self.keypoints.len()).collect();
        order.sort_by(|a, b| self.keypoints[*b].scale.total_cmp(&self.keypoints[*a].scale));
        order.truncate(most);
        Self {
            keypoints: order.iter().map(|i| self.keypoints[*i]).collect(),
            descriptors: order
                .iter()
                .flat_map(|i| &self.descriptors[DESCRIPTOR * i..][..DESCRIPTOR])
                .copied()
                .collect(),
        }
    }
}

/// The pixel at a coordinate.
fn pixel(at: f64, size: usize) -> usize {
    (at as usize).min(size - 1)
}

/// The extrema of an octave, some rows after the others; `images` come before its own.
fn extrema(octave: &Octave, images: usize) -> Vec<Extremum> {
    let (width, height) = (octave.width, octave.height);
    if width.min(height) <= 2 * BORDER {
        return Vec::new();
    }
    let rows = height - 2 * BORDER;
    let mut bands: Vec<Vec<Extremum>> = vec![Vec::new(); rows.div_ceil(GRAIN)];
    parallel::for_chunks(&mut bands, 1, |band, found| {
        let (first, count) = (BORDER + band * GRAIN, GRAIN.min(rows - band * GRAIN));
        let differences = Differences::new(octave, first - 1, count + 2);
        let mut places = Vec::new();
        for layer in 1..=SCALES {
            for y in first..first + count {
                places.clear();
                lanes::run(Row { differences: &differences, layer, y, found: &mut places });
                found[0].extend(places.iter().filter_map(|x| refined(octave, images, layer, *x, y)));
            }
        }
    });
    bands.into_iter().flatten().collect()
}

/// Some rows of the differences of an octave's images.
struct Differences {
    first: usize,
    rows: usize,
    width: usize,
    /// Pixels from row to row: beyond the width lie zeros.
    stride: usize,
    values: Vec<f32>,
}

impl Differences {
    fn new(octave: &Octave, first: usize, rows: usize) -> Self {
        let (width, stride) = (octave.width, octave.width + WINDOW);
        let mut values = vec![0.0; (IMAGES - 1) * rows * stride];
        for (number, values) in values.chunks_exact_mut(rows * stride).enumerate() {
            let (image, next) = (octave.image(number), octave.image(number + 1));
            for (i, row) in values.chunks_exact_mut(stride).enumerate() {
                let pair = next.row(first + i).iter().zip(image.row(first + i));
                row.iter_mut().zip(pair).for_each(|(to, (b, a))| *to = b - a);
            }
        }
        Self { first, rows, width, stride, values }
    }

    /// A row from pixel `x` on, beyond its end too.
    #[inline(always)]
    fn row(&self, number: usize, y: usize) -> &[f32] {
        &self.values[(number * self.rows + y - self.first) * self.stride..][..self.stride]
    }
}

/// The extrema of a row among the pixels around them in three images, with enough contrast to be refined.
struct Row<'a> {
    differences: &'a Differences,
    layer: usize,
    y: usize,
    found: &'a mut Vec<usize>,
}

impl LaneKernel<f32> for Row<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lanes<Scalar = f32>>(self) {
        let Self { differences, layer, y, found } = self;
        let (end, least) = (differences.width - BORDER, V::splat(0.5 * CONTRAST / SCALES as f32));
        let lines = [layer, layer - 1, layer + 1].map(
            #[inline(always)]
            |layer| [y, y - 1, y + 1].map(|y| differences.row(layer, y)),
        );
        for x in (BORDER..end).step_by(LANES) {
            let value: V = neighbors(lines[0][0], x)[1];
            let (mut high, mut low) = (value.gt(least), (-value).gt(least));
            // Neither of two equal neighbors is left out.
            for lines in &lines {
                for line in lines {
                    for other in neighbors(line, x) {
                        (high, low) = (value.ge_among(other, high), other.ge_among(value, low));
                    }
                }
                if high.or(low).bits() == 0 {
                    break;
                }
            }
            let mut bits = high.or(low).bits();
            while bits != 0 {
                let lane = bits.trailing_zeros() as usize;
                if x + lane < end {
                    found.push(x + lane);
                }
                bits &= bits - 1;
            }
        }
    }
}

/// The vectors of a row that begin one pixel before `x`, at it, and after it.
#[inline(always)]
fn neighbors<V: Lanes<Scalar = f32>>(row: &[f32], x: usize) -> [V; 3] {
    let row: &[f32; WINDOW] = row[x - 1..x - 1 + WINDOW].first_chunk().expect("a window");
    let vector = |at: usize| V::load(row[at..at + LANES].first_chunk().expect("a vector"));
    [vector(0), vector(1), vector(2)]
}

/// The extremum near a pixel, between pixels and scales; `None` if it has little contrast, lies on an edge, or leads
/// away.
fn refined(octave: &Octave, images: usize, mut layer: usize, mut x: usize, mut y: usize) -> Option<Extremum> {
    let (width, height) = (octave.width, octave.height);
    for _ in 0..MOVES {
        let at = |by: isize, x: usize, y: usize| octave.difference(layer.wrapping_add_signed(by), x, y);
        let value = at(0, x, y);
        let slope = 0.5
            * Vec3::new(
                at(0, x + 1, y) - at(0, x - 1, y),
                at(0, x, y + 1) - at(0, x, y - 1),
                at(1, x, y) - at(-1, x, y),
            );
        let xx = at(0, x + 1, y) + at(0, x - 1, y) - 2.0 * value;
        let yy = at(0, x, y + 1) + at(0, x, y - 1) - 2.0 * value;
        let ss = at(1, x, y) + at(-1, x, y) - 2.0 * value;
        let xy = 0.25 * (at(0, x + 1, y + 1) + at(0, x - 1, y - 1) - at(0, x - 1, y + 1) - at(0, x + 1, y - 1));
        let xs = 0.25 * (at(1, x + 1, y) + at(-1, x - 1, y) - at(1, x - 1, y) - at(-1, x + 1, y));
        let ys = 0.25 * (at(1, x, y + 1) + at(-1, x, y - 1) - at(1, x, y - 1) - at(-1, x, y + 1));
        let curvature = Mat3::from_cols_array(&[xx, xy, xs, xy, yy, ys, xs, ys, ss]);
        let offset = -(curvature.inverse() * slope);
        if !offset.is_finite() {
            return None;
        }
        if offset.abs().max_element() < NEAR {
            let contrast = (value + 0.5 * slope.dot(offset)).abs();
            let (trace, determinant) = (xx + yy, xx * yy - xy * xy);
            let edge = determinant <= 0.0 || trace * trace * EDGE >= (EDGE + 1.0) * (EDGE + 1.0) * determinant;
            if contrast < CONTRAST / SCALES as f32 || edge {
                return None;
            }
            let at = Vec2::new(x as f32 + offset.x, y as f32 + offset.y);
            let sigma = SIGMA * ((layer as f32 + offset.z) / SCALES as f32).exp2();
            return Some(Extremum {
                place: Place { at, sigma },
                image: images + layer - 1,
                pixel: at.as_dvec2() * octave.step + octave.origin,
                scale: f64::from(sigma) * octave.step,
                contrast,
                rank: usize::MAX,
            });
        }
        let moved = |at: usize, by: f32| at as f32 + by.clamp(-2.0, 2.0).round();
        let (to_x, to_y, to_layer) = (moved(x, offset.x), moved(y, offset.y), moved(layer, offset.z));
        let inside = to_x >= BORDER as f32 && to_x < (width - BORDER) as f32;
        let inside = inside && to_y >= BORDER as f32 && to_y < (height - BORDER) as f32;
        if !inside || to_layer < 1.0 || to_layer > SCALES as f32 {
            return None;
        }
        (x, y, layer) = (to_x as usize, to_y as usize, to_layer as usize);
    }
    None
}
