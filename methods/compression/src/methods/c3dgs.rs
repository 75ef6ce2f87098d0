//! C3DGS (Niedermayr et al., 2024): codebooks of colors and of shapes, weighted by the sensitivity of pictures.

use crate::codes::Codes;
use crate::method::Point;
use crate::payload::{Grid, Reader, Writer, broken};
use crate::recovery::{Recovery, trainable};
use crate::shapes::{decomposed, normalized};
use crate::views::sensitivities;
use crate::{CompressionError, Method, Schedule, Task, Training};
use std::error::Error;
use weaver_fit::Rounding;
use weaver_scene::Gaussians;

/// Bits of a coordinate.
const DEPTH: u32 = 16;
/// The largest symbol of sizes and opacities, of 8 bits.
const LARGEST: f32 = 255.0;
/// Numbers of a shape: the upper half of a covariance.
const SHAPE: usize = 6;

/// Colors with all harmonics by a codebook, shapes (covariances over their trace) by another, each weighted by
/// sensitivity; 8 bits of sizes and opacities; trained with colors as their codes and opacities rounded.
#[derive(Clone, Copy, Debug)]
pub struct C3dgs {
    /// Most codes of each codebook, 4096 in the paper.
    pub codes: usize,
}

impl C3dgs {
    pub(crate) fn points() -> Vec<Point> {
        let point = |codes: usize| Point { setting: format!("{codes} codes"), method: Box::new(Self { codes }) };
        [4096, 512].map(point).into()
    }
}

impl Method for C3dgs {
    fn steps(&self, of: usize) -> usize {
        of
    }

    fn begin<'a>(&'a self, task: &'a Task<'a>) -> Result<Box<dyn Training + 'a>, CompressionError> {
        let gaussians = trainable(task.gaussians)?;
        let [of_colors, of_shapes] = sensitivities(&gaussians, &task.pictures)?;
        let colors = Codes::fit(&gaussians.sh, 3 * gaussians.coefficients(), &of_colors, self.codes)?;
        let shapes: Vec<f32> = (0..gaussians.len()).flat_map(|i| normalized(&gaussians, i).1).collect();
        let codes_of_shapes = Codes::fit(&shapes, SHAPE, &of_shapes, self.codes)?;
        let rounding = Coded { colors: colors.clone() };
        let write = move |it: &Gaussians| write(it, &colors, (&codes_of_shapes, &shapes));
        let training = Recovery::new(task, gaussians, Schedule::default(), self.steps(task.steps), write);
        Ok(Box::new(training.rounded(move || Box::new(rounding.clone()))))
    }

    fn decode(&self, bytes: &[u8]) -> Result<Gaussians, CompressionError> {
        read(bytes)
    }
}

/// Training with colors as their codes, and opacities rounded.
#[derive(Clone, Debug)]
struct Coded {
    colors: Codes,
}

impl Rounding for Coded {
    fn rounded(&mut self, gaussians: &Gaussians) -> Result<Gaussians, Box<dyn Error + Send + Sync>> {
        let (low, step, symbols) = in_8_bits(gaussians.opacity_logits.iter().map(|x| x.clamp(-LOGIT, LOGIT)).collect());
        Ok(Gaussians {
            sh: self.colors.rounded(&gaussians.sh),
            opacity_logits: symbols.into_iter().map(|s| low + step * s as f32).collect(),
            ..gaussians.clone()
        })
    }
}

/// Largest magnitude of a logit before rounding.
const LOGIT: f32 = 8.0;

/// Least value, step and symbols of numbers in 8 bits.
fn in_8_bits(values: Vec<f32>) -> (f32, f32, Vec<u32>) {
    let low = values.iter().copied().fold(f32::INFINITY, f32::min);
    let high = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let step = ((high - low) / LARGEST).max(f32::MIN_POSITIVE);
    (low, step, values.iter().map(|x| ((x - low) / step).round().clamp(0.0, LARGEST) as u32).collect())
}

fn write(gaussians: &Gaussians, colors: &Codes, (shapes, rows): (&Codes, &[f32])) -> Result<Vec<u8>, CompressionError> {
    let (grid, order) = Grid::new(gaussians, DEPTH)?;
    let sizes = order.iter().map(|&(_, i)| normalized(gaussians, i).0).collect();
    let logits = order.iter().map(|&(_, i)| gaussians.opacity_logits[i].clamp(-LOGIT, LOGIT)).collect();
    let (least_size, size_step, sizes) = in_8_bits(sizes);
    let (least_logit, logit_step, logits) = in_8_bits(logits);
    let mut writer = Writer::default();
    writer.positions(&grid, &order)?;
    writer.floats(b"rang", &[least_size, size_step, least_logit, logit_step]);
    writer.symbols(b"size", LARGEST as usize + 1, &sizes, 1);
    writer.symbols(b"opac", LARGEST as usize + 1, &logits, 1);
    let sorted = |codes: &Codes| -> Vec<u32> { order.iter().map(|&(_, i)| codes.of[i]).collect() };
    for (book, code, codes, rows, width) in [
        (b"colb", b"colo", colors, &gaussians.sh[..], 3 * gaussians.coefficients()),
        (b"shab", b"shap", shapes, rows, SHAPE),
    ] {
        writer.halves(book, &codes.means(rows), width);
        writer.symbols(code, codes.count(), &sorted(codes), 1);
    }
    Ok(writer.finish(gaussians.len(), gaussians.degree))
}

fn read(bytes: &[u8]) -> Result<Gaussians, CompressionError> {
    let mut reader = Reader::new(bytes)?;
    let (count, degree) = (reader.gaussians(), reader.degree()?);
    let (grid, codes) = reader.positions(DEPTH)?;
    let ranges = reader.floats(b"rang", 4)?;
    if !ranges.iter().all(|x| x.is_finite()) {
        return Err(broken("stream rang", "finite numbers", format!("{ranges:?}")));
    }
    let sizes = reader.symbols(b"size", LARGEST as usize + 1, count, 1)?;
    let logits = reader.symbols(b"opac", LARGEST as usize + 1, count, 1)?;
    let mut gaussians = Gaussians { degree, ..Gaussians::default() };
    let mut coded = |book: &[u8; 4], code: &[u8; 4], width: usize| {
        let rows = reader.rows(width, 1 << 15)?;
        let book = reader.halves(book, rows, width)?;
        let of = reader.symbols(code, rows.max(1), count, 1)?;
        Codes::spread(&book, width, &of)
    };
    gaussians.sh = coded(b"colb", b"colo", 3 * gaussians.coefficients())?;
    let shapes = coded(b"shab", b"shap", SHAPE)?;
    gaussians.means = codes.into_iter().map(|code| grid.mean(code)).collect();
    gaussians.opacity_logits = logits.into_iter().map(|s| ranges[2] + ranges[3] * s as f32).collect();
    for (size, shape) in sizes.into_iter().zip(shapes.as_chunks::<SHAPE>().0) {
        let (log_scales, quat) = decomposed(ranges[0] + ranges[1] * size as f32, shape);
        gaussians.log_scales.push(log_scales);
        gaussians.quats.push(quat);
    }
    Ok(gaussians)
}
