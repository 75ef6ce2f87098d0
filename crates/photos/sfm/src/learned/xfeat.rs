//! XFeat: keypoints and descriptors of a gray photo by convolutions.

use super::sample::{bicubic, bilinear, nearest};
use super::weights::{Reader, WeightsFault};
use super::{LEARNED_DESCRIPTOR, LearnedFeatures};
use weaver_kernels::conv::{Conv2dShape, conv2d_forward};
use weaver_kernels::exp::exp_f32;
use weaver_kernels::parallel::for_chunks;
use weaver_kernels::resample::Resample;

/// Variances are divided by after this is added, in every normalization.
const EPSILON: f32 = 1e-5;
/// Sides of photos are multiples of this inside the network.
const MULTIPLE: usize = 32;
/// Sides of a cell, which has one logit for each of its pixels and one for none.
const CELL: usize = 8;
const LOGITS: usize = CELL * CELL + 1;
/// Probability from which on a pixel may be a keypoint, and pixels around it in which none is more probable.
const KEYPOINT: f32 = 0.05;
const AROUND: usize = 2;
/// Elements of a task.
const GRAIN: usize = 1 << 14;

/// A map `[c, h, w]`.
#[derive(Clone, Debug)]
pub(super) struct Map {
    pub c: usize,
    pub h: usize,
    pub w: usize,
    pub values: Vec<f32>,
}

/// A convolution, with the normalization after it folded in.
#[derive(Clone, Debug)]
struct Conv {
    o: usize,
    c: usize,
    kernel: usize,
    stride: usize,
    weight: Vec<f32>,
    bias: Vec<f32>,
    relu: bool,
}

impl Conv {
    /// A convolution with a bias.
    fn biased(reader: &Reader<'_>, name: &str, [o, c]: [usize; 2]) -> Result<Self, WeightsFault> {
        let weight = reader.get(&format!("{name}.weight"), &[o, c, 1, 1])?;
        let bias = reader.get(&format!("{name}.bias"), &[o])?;
        Ok(Self { o, c, kernel: 1, stride: 1, weight, bias, relu: false })
    }

    /// A convolution without a bias, then a normalization by running statistics, then the rectifier.
    fn normalized(reader: &Reader<'_>, name: &str, [o, c, kernel, stride]: [usize; 4]) -> Result<Self, WeightsFault> {
        let mut weight = reader.get(&format!("{name}.layer.0.weight"), &[o, c, kernel, kernel])?;
        let mean = reader.get(&format!("{name}.layer.1.running_mean"), &[o])?;
        let variance = reader.get(&format!("{name}.layer.1.running_var"), &[o])?;
        let scale: Vec<f32> = variance.iter().map(|v| 1.0 / (v + EPSILON).sqrt()).collect();
        let rows = weight.chunks_exact_mut(c * kernel * kernel).zip(&scale);
        rows.for_each(|(row, scale)| row.iter_mut().for_each(|w| *w *= scale));
        let bias = mean.iter().zip(&scale).map(|(mean, scale)| -mean * scale).collect();
        Ok(Self { o, c, kernel, stride, weight, bias, relu: true })
    }

    fn forward(&self, x: &Map) -> Map {
        let Self { o, c, kernel, stride, .. } = *self;
        let shape = Conv2dShape { n: 1, c, h: x.h, w: x.w, o, kh: kernel, kw: kernel, stride, pad: kernel / 2 };
        let (h, w) = (shape.out_h(), shape.out_w());
        let mut values = vec![0.0; o * h * w];
        conv2d_forward(&shape, &x.values, &self.weight, Some(&self.bias), &mut values);
        if self.relu {
            for_chunks(&mut values, GRAIN, |_, y| y.iter_mut().for_each(|y| *y = y.max(0.0)));
        }
        Map { c: o, h, w, values }
    }
}

/// Convolutions one after the other.
#[derive(Clone, Debug)]
struct Stack(Vec<Conv>);

impl Stack {
    /// Normalized convolutions of these outputs, inputs, kernels and strides.
    fn read(reader: &Reader<'_>, name: &str, sizes: &[[usize; 4]]) -> Result<Self, WeightsFault> {
        let conv = |(i, size): (usize, &[usize; 4])| Conv::normalized(reader, &format!("{name}.{i}"), *size);
        Ok(Self(sizes.iter().enumerate().map(conv).collect::<Result<_, _>>()?))
    }

    /// The same with a convolution of 1 x 1 with a bias at the end.
    fn ending(reader: &Reader<'_>, name: &str, sizes: &[[usize; 4]], last: [usize; 2]) -> Result<Self, WeightsFault> {
        let mut stack = Self::read(reader, name, sizes)?;
        stack.0.push(Conv::biased(reader, &format!("{name}.{}", sizes.len()), last)?);
        Ok(stack)
    }

    fn forward(&self, x: &Map) -> Map {
        let first = self.0[0].forward(x);
        self.0[1..].iter().fold(first, |x, conv| conv.forward(&x))
    }
}

/// The network.
#[derive(Clone, Debug)]
pub(super) struct Extractor {
    skip: Conv,
    blocks: [Stack; 5],
    fusion: Stack,
    reliability: Stack,
    keypoints: Stack,
}

impl Extractor {
    pub fn read(reader: &Reader<'_>) -> Result<Self, WeightsFault> {
        let wide = [64, 64, 3, 1];
        let narrow = [64, 64, 1, 1];
        Ok(Self {
            skip: Conv::biased(reader, "skip1.1", [24, 1])?,
            blocks: [
                Stack::read(reader, "block1", &[[4, 1, 3, 1], [8, 4, 3, 2], [8, 8, 3, 1], [24, 8, 3, 2]])?,
                Stack::read(reader, "block2", &[[24, 24, 3, 1]; 2])?,
                Stack::read(reader, "block3", &[[64, 24, 3, 2], wide, narrow])?,
                Stack::read(reader, "block4", &[[64, 64, 3, 2], wide, wide])?,
                Stack::read(reader, "block5", &[[128, 64, 3, 2], [128, 128, 3, 1], [128, 128, 3, 1], [64, 128, 1, 1]])?,
            ],
            fusion: Stack::ending(reader, "block_fusion", &[wide; 2], [64, 64])?,
            reliability: Stack::ending(reader, "heatmap_head", &[narrow; 2], [1, 64])?,
            keypoints: Stack::ending(reader, "keypoint_head", &[narrow; 3], [LOGITS, 64])?,
        })
    }

    /// Keypoints and descriptors; see [`LearnedMatcher::features`](super::LearnedMatcher::features).
    ///
    /// The network sees the photo at the size `shown`, rounded down.
    pub fn features(
        &self,
        (rgb, size): (&[u8], [usize; 2]),
        shown: [usize; 2],
        mask: Option<&[bool]>,
        most: usize,
    ) -> LearnedFeatures {
        let inside = shown.map(|side| side / MULTIPLE * MULTIPLE);
        if inside.contains(&0) {
            return LearnedFeatures { size, ..LearnedFeatures::default() };
        }
        let x = normalized(rgb, size, inside);
        let [descriptors, reliability, logits] = self.maps(&x);
        let [height, width] = inside;
        let probability = probabilities(&logits);
        let back = [1, 0].map(|axis| size[axis] as f32 / inside[axis] as f32);
        let shown = |[x, y]: [f32; 2]| {
            mask.is_none_or(|mask| {
                let column = ((x * back[0] + 0.5) as usize).min(size[1] - 1);
                mask[((y * back[1] + 0.5) as usize).min(size[0] - 1) * size[1] + column]
            })
        };
        let mut found: Vec<([f32; 2], f32)> = Vec::new();
        for [x, y] in peaks(&probability, inside) {
            let at = [x as f32, y as f32];
            let sample = |map: [usize; 2]| place(at, inside, map);
            let score = nearest(&probability, inside, sample(inside))
                * bilinear(&reliability.values, [reliability.h, reliability.w], sample([reliability.h, reliability.w]));
            // The corner is how the original marks that there is no keypoint.
            if score > 0.0 && [x, y] != [0, 0] && shown(at) {
                found.push((at, score));
            }
        }
        found.sort_by(|a, b| b.1.total_cmp(&a.1));
        found.truncate(most);
        let map = [descriptors.h, descriptors.w];
        let rows = unit_rows(&descriptors);
        let mut of_points = vec![0.0; found.len() * LEARNED_DESCRIPTOR];
        for_chunks(&mut of_points, LEARNED_DESCRIPTOR, |i, out| {
            bicubic(&rows, map, place(found[i].0, [height, width], map), out);
            unit(out);
        });
        LearnedFeatures {
            size,
            pixel: back,
            points: found.iter().map(|([x, y], _)| [x * back[0], y * back[1]]).collect(),
            scores: found.iter().map(|(_, score)| *score).collect(),
            descriptors: of_points,
        }
    }

    /// Descriptors `[64, h / 8, w / 8]`, their reliability `[1, h / 8, w / 8]` from 0 to 1, and logits of keypoints
    /// `[65, h / 8, w / 8]`.
    fn maps(&self, x: &Map) -> [Map; 3] {
        let mut x1 = self.blocks[0].forward(x);
        add(&mut x1.values, &self.skip.forward(&quarter(x)).values);
        let x2 = self.blocks[1].forward(&x1);
        let mut x3 = self.blocks[2].forward(&x2);
        let x4 = self.blocks[3].forward(&x3);
        let x5 = self.blocks[4].forward(&x4);
        for coarse in [x4, x5] {
            let mut enlarged = vec![0.0; x3.values.len()];
            let resample = Resample::<f32>::bilinear([coarse.h, coarse.w], [x3.h, x3.w], false);
            resample.forward(&coarse.values, &mut enlarged);
            add(&mut x3.values, &enlarged);
        }
        let descriptors = self.fusion.forward(&x3);
        let mut reliability = self.reliability.forward(&descriptors);
        reliability.values.iter_mut().for_each(|x| *x = 1.0 / (1.0 + exp_f32(-*x)));
        let logits = self.keypoints.forward(&cells(x));
        [descriptors, reliability, logits]
    }
}

/// A photo in gray at another size, with mean 0 and deviation 1.
fn normalized(rgb: &[u8], size: [usize; 2], inside: [usize; 2]) -> Map {
    let gray: Vec<f32> =
        rgb.chunks_exact(3).map(|c| (f32::from(c[0]) + f32::from(c[1]) + f32::from(c[2])) / 765.0).collect();
    let [h, w] = inside;
    let mut values = vec![0.0; h * w];
    if size == inside {
        values.copy_from_slice(&gray);
    } else {
        Resample::<f32>::bilinear(size, inside, false).forward(&gray, &mut values);
    }
    let count = values.len() as f64;
    let mean = values.iter().map(|x| f64::from(*x)).sum::<f64>() / count;
    let variance = values.iter().map(|x| (f64::from(*x) - mean).powi(2)).sum::<f64>() / count;
    let scale = 1.0 / (variance + f64::from(EPSILON)).sqrt();
    values.iter_mut().for_each(|x| *x = ((f64::from(*x) - mean) * scale) as f32);
    Map { c: 1, h, w, values }
}

/// Means of 4 x 4 pixels of a map of one channel.
fn quarter(x: &Map) -> Map {
    let (h, w) = (x.h / 4, x.w / 4);
    let mean = |i: usize| {
        let (y, column) = (i / w * 4, i % w * 4);
        (0..4).map(|k| x.values[(y + k) * x.w + column..][..4].iter().sum::<f32>()).sum::<f32>() / 16.0
    };
    Map { c: 1, h, w, values: (0..h * w).map(mean).collect() }
}

/// Cells of 8 x 8 pixels as channels.
fn cells(x: &Map) -> Map {
    let (h, w) = (x.h / CELL, x.w / CELL);
    let mut values = vec![0.0; CELL * CELL * h * w];
    for_chunks(&mut values, h * w, |pixel, values| {
        let (down, across) = (pixel / CELL, pixel % CELL);
        for (i, value) in values.iter_mut().enumerate() {
            *value = x.values[(i / w * CELL + down) * x.w + i % w * CELL + across];
        }
    });
    Map { c: CELL * CELL, h, w, values }
}

fn add(to: &mut [f32], from: &[f32]) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
}

/// The probability of each pixel `[8 h, 8 w]`, from logits of cells `[65, h, w]`.
fn probabilities(logits: &Map) -> Vec<f32> {
    let (h, w) = (logits.h, logits.w);
    let mut all = vec![0.0; CELL * h * CELL * w];
    for_chunks(&mut all, CELL * CELL * w, |row, all| {
        for column in 0..w {
            let logit = |k: usize| logits.values[k * h * w + row * w + column];
            let top = (0..LOGITS).map(logit).fold(f32::NEG_INFINITY, f32::max);
            let powers: [f32; LOGITS] = std::array::from_fn(|k| exp_f32(logit(k) - top));
            let total: f32 = powers.iter().sum();
            for (k, power) in powers.iter().take(CELL * CELL).enumerate() {
                all[k / CELL * CELL * w + column * CELL + k % CELL] = power / total;
            }
        }
    });
    all
}

/// Pixels `[x, y]`, row by row, that are probable enough, and less so than none of the 5 x 5 around them.
fn peaks(probability: &[f32], [height, width]: [usize; 2]) -> Vec<[usize; 2]> {
    let mut found: Vec<Vec<[usize; 2]>> = vec![Vec::new(); height];
    for_chunks(&mut found, 16, |chunk, found| {
        for (y, found) in (16 * chunk..).zip(found) {
            for x in 0..width {
                let here = probability[y * width + x];
                let mut rows = y.saturating_sub(AROUND)..(y + AROUND + 1).min(height);
                let columns = x.saturating_sub(AROUND)..(x + AROUND + 1).min(width);
                let less = |row: usize| probability[row * width..][columns.clone()].iter().all(|other| *other <= here);
                if here > KEYPOINT && rows.all(less) {
                    found.push([x, y]);
                }
            }
        }
    });
    found.concat()
}

/// Where a pixel of the photo lies in a smaller map of it, `[x, y]`. The first and the last pixel lie at the borders of
/// the map, half a pixel of it outside, as the network was trained.
fn place([x, y]: [f32; 2], [height, width]: [usize; 2], [rows, columns]: [usize; 2]) -> [f32; 2] {
    let along = |at: f32, side: usize, of: usize| {
        let grid = 2.0 * (at / (side - 1) as f32) - 1.0;
        ((grid + 1.0) * of as f32 - 1.0) / 2.0
    };
    [along(x, width, columns), along(y, height, rows)]
}

/// Descriptors of a map, one after the other and of length 1.
fn unit_rows(map: &Map) -> Vec<f32> {
    let pixels = map.h * map.w;
    let mut rows = vec![0.0; map.values.len()];
    for_chunks(&mut rows, map.c, |pixel, row| {
        row.iter_mut().enumerate().for_each(|(channel, value)| *value = map.values[channel * pixels + pixel]);
        unit(row);
    });
    rows
}

fn unit(row: &mut [f32]) {
    let length = row.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-12);
    row.iter_mut().for_each(|x| *x /= length);
}
