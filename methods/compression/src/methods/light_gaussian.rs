//! LightGaussian (Fan et al., 2023): pruned, distilled to fewer harmonics, and a codebook of these.

use super::pruning::{kept, significance};
use crate::codes::{Codes, rest_of};
use crate::method::Point;
use crate::payload::{Grid, Reader, Writer};
use crate::recovery::{Change, Recovery, trainable};
use crate::{CompressionError, Method, Schedule, Task, Training};
use weaver_scene::Gaussians;

/// Bits of a coordinate.
const DEPTH: u32 = 16;
/// Degree of the distilled harmonics.
const DEGREE: usize = 2;
/// Codes of harmonics, and the share of coded rows: the least significant Gaussians.
const CODES: usize = 8192;
const CODED: f64 = 0.6;
/// Largest magnitude of a written logit.
const LOGIT: f32 = 16.0;

/// Gaussians pruned by weight and volume, then trained; harmonics of degree 3 left out and the others trained to make
/// up for it; a codebook for the harmonics of 60 % of the Gaussians. Everything else but positions is 16-bit floats.
#[derive(Clone, Copy, Debug)]
pub struct LightGaussian {
    /// Share of the kept Gaussians, 0.34 in the paper.
    pub keep: f64,
}

impl LightGaussian {
    pub(crate) fn points() -> Vec<Point> {
        let point = |keep: f64| Point { setting: format!("keeps {keep}"), method: Box::new(Self { keep }) };
        [1.0, 0.67, 0.34].map(point).into()
    }
}

impl Method for LightGaussian {
    fn steps(&self, of: usize) -> usize {
        2 * of
    }

    fn begin<'a>(&'a self, task: &'a Task<'a>) -> Result<Box<dyn Training + 'a>, CompressionError> {
        let keep = self.keep;
        let prune: Change<'_> = Box::new(move |it| Ok(kept(it, &significance(it, task)?, keep)));
        let cut: Change<'_> = Box::new(|it| Ok(it.with_degree(it.degree.min(DEGREE))));
        let schedule = Schedule::new(vec![(0, 0, prune), (task.steps, 0, cut)]);
        let write = |it: &Gaussians| write(it, &significance(it, task)?);
        Ok(Box::new(Recovery::new(task, trainable(task.gaussians)?, schedule, self.steps(task.steps), write)))
    }

    fn decode(&self, bytes: &[u8]) -> Result<Gaussians, CompressionError> {
        read(bytes)
    }
}

fn write(gaussians: &Gaussians, significance: &[f32]) -> Result<Vec<u8>, CompressionError> {
    let (grid, order) = Grid::new(gaussians, DEPTH)?;
    let numbers: Vec<usize> = order.iter().map(|(_, i)| *i).collect();
    let sorted = gaussians.select(&numbers);
    let values: Vec<f32> = numbers.iter().map(|&i| significance[i]).collect();
    let mut writer = Writer::default();
    writer.positions(&grid, &order)?;
    writer.halves(b"scal", sorted.log_scales.as_flattened(), 3);
    writer.halves(b"rota", sorted.quats.as_flattened(), 4);
    let logits: Vec<f32> = sorted.opacity_logits.iter().map(|x| x.clamp(-LOGIT, LOGIT)).collect();
    writer.halves(b"opac", &logits, 1);
    let coefficients = sorted.coefficients();
    let first: Vec<f32> = sorted.sh.chunks_exact(3 * coefficients).flat_map(|row| row[..3].iter().copied()).collect();
    writer.halves(b"colo", &first, 3);
    let width = 3 * (coefficients - 1);
    if width > 0 {
        let fine = sorted.largest(&values, ((1.0 - CODED) * sorted.len() as f64) as usize);
        let mut coded = vec![1_u32; sorted.len()];
        fine.iter().for_each(|&i| coded[i] = 0);
        let rest = rest_of(&sorted.sh, coefficients);
        let part = |kind: u32| -> Vec<f32> {
            let rows = rest.chunks_exact(width).zip(&coded).filter(|(_, coded)| **coded == kind);
            rows.flat_map(|(row, _)| row.iter().copied()).collect()
        };
        let weights: Vec<f64> =
            values.iter().zip(&coded).filter(|(_, coded)| **coded == 1).map(|(x, _)| f64::from(*x)).collect();
        let rows = part(1);
        let codes = Codes::fit(&rows, width, &weights, CODES)?;
        writer.symbols(b"kind", 2, &coded, 1);
        writer.halves(b"book", &codes.means(&rows), width);
        writer.symbols(b"code", codes.count(), &codes.of, 1);
        writer.halves(b"rest", &part(0), width);
    }
    Ok(writer.finish(sorted.len(), sorted.degree))
}

fn read(bytes: &[u8]) -> Result<Gaussians, CompressionError> {
    let mut reader = Reader::new(bytes)?;
    let (count, degree) = (reader.gaussians(), reader.degree()?);
    let (grid, codes) = reader.positions(DEPTH)?;
    let mut gaussians = Gaussians {
        means: codes.into_iter().map(|code| grid.mean(code)).collect(),
        log_scales: reader.halves(b"scal", count, 3)?.as_chunks().0.to_vec(),
        quats: reader.halves(b"rota", count, 4)?.as_chunks().0.to_vec(),
        opacity_logits: reader.halves(b"opac", count, 1)?,
        sh: Vec::new(),
        degree,
    };
    let first = reader.halves(b"colo", count, 3)?;
    let width = 3 * (gaussians.coefficients() - 1);
    if width == 0 {
        gaussians.sh = first;
        return Ok(gaussians);
    }
    let coded = reader.symbols(b"kind", 2, count, 1)?;
    let many = coded.iter().filter(|coded| **coded == 1).count();
    let rows = reader.rows(width, CODES)?;
    let book = reader.halves(b"book", rows, width)?;
    let of = reader.symbols(b"code", rows.max(1), many, 1)?;
    let rest = [reader.halves(b"rest", count - many, width)?, Codes::spread(&book, width, &of)?];
    let mut rest = rest.each_ref().map(|rows| rows.chunks_exact(width));
    for (first, kind) in first.chunks_exact(3).zip(coded) {
        gaussians.sh.extend(first);
        gaussians.sh.extend(rest[kind as usize].next().into_iter().flatten());
    }
    Ok(gaussians)
}
