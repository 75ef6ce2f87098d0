//! MesonGS (Xie et al., 2024): pruned, an octree, RAHT of everything but further harmonics, and a codebook of these.

use super::pruning::{kept, significance};
use crate::codes::{Codes, rest_of};
use crate::method::Point;
use crate::payload::{Grid, Reader, Writer};
use crate::recovery::{Recovery, trainable};
use crate::{CompressionError, Method, Schedule, Task, Training};
use std::error::Error;
use weaver_codec::Raht;
use weaver_fit::Rounding;
use weaver_geometry::glam::{DQuat, EulerRot};
use weaver_scene::Gaussians;

/// Levels of the octree.
const DEPTH: u32 = 12;
/// Blocks of coefficients with their own ranges, and the least size of a block.
const BLOCKS: usize = 66;
const LEAST: usize = 128;
/// The largest symbol of a coefficient, of 8 bits.
const LARGEST: f64 = 255.0;
/// Codes of harmonics.
const CODES: usize = 2048;
/// Transformed numbers of a Gaussian: opacity, scales, Euler angles, the first harmonics.
const CHANNELS: usize = 10;
/// Steps of training, of 5000.
const STEPS: f64 = 3000.0 / 5000.0;

/// Gaussians pruned by weight and volume; positions on a grid of 2^12; opacity, scales, Euler angles and colors
/// transformed by RAHT and rounded to 8 bits in 66 blocks; further harmonics by a codebook; trained with all of this in
/// place.
#[derive(Clone, Copy, Debug)]
pub struct MesonGs {
    /// Share of the kept Gaussians, 0.34 in the paper.
    pub keep: f64,
}

impl MesonGs {
    pub(crate) fn points() -> Vec<Point> {
        let point = |keep: f64| Point { setting: format!("keeps {keep}"), method: Box::new(Self { keep }) };
        [1.0, 0.67, 0.34].map(point).into()
    }
}

impl Method for MesonGs {
    fn steps(&self, of: usize) -> usize {
        (STEPS * of as f64) as usize
    }

    fn begin<'a>(&'a self, task: &'a Task<'a>) -> Result<Box<dyn Training + 'a>, CompressionError> {
        let whole = trainable(task.gaussians)?;
        let pruned = kept(&whole, &significance(&whole, task)?, self.keep);
        let codes = codes_of(&pruned, task)?;
        let rounding = Transformed { codes: codes.clone() };
        let write = move |it: &Gaussians| write(it, codes.as_ref());
        let training = Recovery::new(task, pruned, Schedule::default(), self.steps(task.steps), write);
        Ok(Box::new(training.rounded(move || Box::new(rounding.clone()))))
    }

    fn decode(&self, bytes: &[u8]) -> Result<Gaussians, CompressionError> {
        read(bytes)
    }
}

/// Codes of the further harmonics; `None` without any.
fn codes_of(gaussians: &Gaussians, task: &Task<'_>) -> Result<Option<Codes>, CompressionError> {
    let width = 3 * (gaussians.coefficients() - 1);
    if width == 0 {
        return Ok(None);
    }
    let weights: Vec<f64> = significance(gaussians, task)?.into_iter().map(f64::from).collect();
    Ok(Some(Codes::fit(&rest_of(&gaussians.sh, gaussians.coefficients()), width, &weights, CODES)?))
}

/// Ranges of blocks, least value and step, and symbols: of coefficients from coarse to fine, `[N - 1, 10]`; the mean
/// apart.
struct Coefficients {
    mean: Vec<f32>,
    ranges: Vec<f32>,
    symbols: Vec<u32>,
}

/// Coefficients of a block, given their total number.
fn block(count: usize) -> usize {
    count.div_ceil(BLOCKS).max(LEAST)
}

impl Coefficients {
    fn new(mut values: Vec<f64>, raht: &Raht) -> Self {
        raht.forward(&mut values, CHANNELS);
        let order = raht.order();
        let row = |i: usize| &values[CHANNELS * i..][..CHANNELS];
        let mean = row(order[0]).iter().map(|x| *x as f32).collect();
        let (mut ranges, mut symbols) = (Vec::new(), Vec::new());
        for block in order[1..].chunks(block(order.len() - 1)) {
            let range = |channel: usize| {
                let of =
                    |start: f64, bound: fn(f64, f64) -> f64| block.iter().map(|&i| row(i)[channel]).fold(start, bound);
                let (low, high) = (of(f64::INFINITY, f64::min), of(f64::NEG_INFINITY, f64::max));
                [low as f32, ((high - low) / LARGEST) as f32]
            };
            let own: [[f32; 2]; CHANNELS] = std::array::from_fn(range);
            for &i in block {
                symbols.extend(row(i).iter().zip(&own).map(|(x, [low, step])| {
                    let places = (x - f64::from(*low)) / f64::from(step.max(f32::MIN_POSITIVE));
                    places.round().clamp(0.0, LARGEST) as u32
                }));
            }
            ranges.extend(own.as_flattened());
        }
        Self { mean, ranges, symbols }
    }

    fn values(&self, raht: &Raht) -> Vec<f64> {
        let order = raht.order();
        let mut values = vec![0.0; CHANNELS * order.len()];
        for (channel, x) in self.mean.iter().enumerate() {
            values[CHANNELS * order[0] + channel] = f64::from(*x);
        }
        let size = block(order.len() - 1);
        for (at, (&i, symbols)) in order[1..].iter().zip(self.symbols.chunks_exact(CHANNELS)).enumerate() {
            let ranges = &self.ranges[2 * CHANNELS * (at / size)..][..2 * CHANNELS];
            for (channel, symbol) in symbols.iter().enumerate() {
                values[CHANNELS * i + channel] =
                    f64::from(ranges[2 * channel]) + f64::from(*symbol) * f64::from(ranges[2 * channel + 1]);
            }
        }
        raht.inverse(&mut values, CHANNELS);
        values
    }
}

/// Largest magnitude of a transformed logit.
const LOGIT: f32 = 16.0;

/// The transformed numbers of a Gaussian.
fn channels(gaussians: &Gaussians, i: usize) -> [f64; CHANNELS] {
    let [w, x, y, z] = gaussians.quats[i].map(f64::from);
    let quat = DQuat::from_xyzw(x, y, z, w);
    let quat = if quat.length_squared() > 0.0 { quat.normalize() } else { DQuat::IDENTITY };
    let (a, b, c) = quat.to_euler(EulerRot::XYZ);
    let [s, t, u] = gaussians.log_scales[i].map(f64::from);
    let [red, green, blue] = [0, 1, 2].map(|k| f64::from(gaussians.sh[3 * gaussians.coefficients() * i + k]));
    [f64::from(gaussians.opacity_logits[i].clamp(-LOGIT, LOGIT)), s, t, u, a, b, c, red, green, blue]
}

/// Sets a Gaussian's numbers in the order of [`channels`].
fn set_channels(gaussians: &mut Gaussians, i: usize, values: &[f64]) {
    gaussians.opacity_logits[i] = values[0] as f32;
    gaussians.log_scales[i] = [1, 2, 3].map(|k| values[k] as f32);
    let quat = DQuat::from_euler(EulerRot::XYZ, values[4], values[5], values[6]);
    gaussians.quats[i] = [quat.w, quat.x, quat.y, quat.z].map(|x| x as f32);
    let width = 3 * gaussians.coefficients();
    (0..3).for_each(|k| gaussians.sh[width * i + k] = values[7 + k] as f32);
}

fn transform(order: &[(u64, usize)]) -> Result<Raht, CompressionError> {
    let codes: Vec<u64> = order.iter().map(|(code, _)| *code).collect();
    Ok(Raht::new(&codes, &vec![1.0; codes.len()])?)
}

/// Training with the transform's rounding in place.
#[derive(Clone, Debug)]
struct Transformed {
    codes: Option<Codes>,
}

impl Rounding for Transformed {
    fn rounded(&mut self, gaussians: &Gaussians) -> Result<Gaussians, Box<dyn Error + Send + Sync>> {
        let mut rounded = gaussians.clone();
        let (grid, order) = Grid::new(gaussians, DEPTH)?;
        let raht = transform(&order)?;
        let values = order.iter().flat_map(|&(_, i)| channels(gaussians, i)).collect();
        let values = Coefficients::new(values, &raht).values(&raht);
        if let Some(codes) = &self.codes {
            let (width, rest) = (3 * gaussians.coefficients(), rest_of(&gaussians.sh, gaussians.coefficients()));
            let rows = codes.rounded(&rest);
            let rows = rows.chunks_exact(width - 3);
            rounded.sh.chunks_exact_mut(width).zip(rows).for_each(|(to, row)| to[3..].copy_from_slice(row));
        }
        for (&(code, i), values) in order.iter().zip(values.chunks_exact(CHANNELS)) {
            rounded.means[i] = grid.mean(code);
            let quat = gaussians.quats[i];
            set_channels(&mut rounded, i, values);
            // Keeps the length and the sign of the optimized quaternion.
            let dot: f32 = rounded.quats[i].iter().zip(quat).map(|(a, b)| a * b).sum();
            let length = quat.iter().map(|x| x * x).sum::<f32>().sqrt();
            rounded.quats[i] = rounded.quats[i].map(|x| if dot < 0.0 { -x * length } else { x * length });
        }
        Ok(rounded)
    }
}

fn write(gaussians: &Gaussians, codes: Option<&Codes>) -> Result<Vec<u8>, CompressionError> {
    let (grid, order) = Grid::new(gaussians, DEPTH)?;
    let raht = transform(&order)?;
    let values = order.iter().flat_map(|&(_, i)| channels(gaussians, i)).collect();
    let Coefficients { mean, ranges, symbols } = Coefficients::new(values, &raht);
    let mut writer = Writer::default();
    writer.positions(&grid, &order)?;
    writer.floats(b"mean", &mean);
    writer.floats(b"rang", &ranges);
    writer.symbols(b"coef", LARGEST as usize + 1, &symbols, CHANNELS);
    if let Some(codes) = codes {
        let means = codes.means(&rest_of(&gaussians.sh, gaussians.coefficients()));
        writer.halves(b"book", &means, 3 * (gaussians.coefficients() - 1));
        let of: Vec<u32> = order.iter().map(|&(_, i)| codes.of[i]).collect();
        writer.symbols(b"code", codes.count(), &of, 1);
    }
    Ok(writer.finish(gaussians.len(), gaussians.degree))
}

fn read(bytes: &[u8]) -> Result<Gaussians, CompressionError> {
    let mut reader = Reader::new(bytes)?;
    let (count, degree) = (reader.gaussians(), reader.degree()?);
    let (grid, codes) = reader.positions(DEPTH)?;
    let order: Vec<(u64, usize)> = codes.into_iter().zip(0..).collect();
    let finer = count.saturating_sub(1);
    let blocks = finer.div_ceil(block(finer));
    let coefficients = Coefficients {
        mean: reader.floats(b"mean", CHANNELS)?,
        ranges: reader.floats(b"rang", 2 * CHANNELS * blocks)?,
        symbols: reader.symbols(b"coef", LARGEST as usize + 1, finer, CHANNELS)?,
    };
    let values = coefficients.values(&transform(&order)?);
    let mut gaussians = Gaussians {
        means: order.iter().map(|(code, _)| grid.mean(*code)).collect(),
        log_scales: vec![[0.0; 3]; count],
        quats: vec![[0.0; 4]; count],
        opacity_logits: vec![0.0; count],
        sh: Vec::new(),
        degree,
    };
    let width = 3 * (gaussians.coefficients() - 1);
    gaussians.sh = vec![0.0; (width + 3) * count];
    if width > 0 {
        let rows = reader.rows(width, CODES)?;
        let book = reader.halves(b"book", rows, width)?;
        let of = reader.symbols(b"code", rows.max(1), count, 1)?;
        let rest = Codes::spread(&book, width, &of)?;
        let rows = gaussians.sh.chunks_exact_mut(width + 3).zip(rest.chunks_exact(width));
        rows.for_each(|(to, row)| to[3..].copy_from_slice(row));
    }
    values.chunks_exact(CHANNELS).enumerate().for_each(|(i, values)| set_channels(&mut gaussians, i, values));
    Ok(gaussians)
}
