//! Vector quantization: codes as importance-weighted moving averages of the vectors nearest to them.

use crate::error::CodecError;
use rayon::prelude::*;

/// Share that a moving average keeps of itself in a round.
const DECAY: f64 = 0.8;

/// Mass below which a code counts as dead.
const DEAD: f64 = 1e-9;

/// Vectors that stand for others, `[K, D]`.
///
/// ```
/// use weaver_codec::Codebook;
///
/// let vectors = [0.0, 0.1, 5.0, 5.1];
/// let codebook = Codebook::fit(&vectors, 1, &[1.0; 4], 2, 30)?;
/// let [low, high] = [0.0, 5.0].map(|x| codebook.codes[codebook.nearest(&[x])]);
/// assert!((low - 0.05).abs() < 0.01 && (high - 5.05).abs() < 0.01);
/// # Ok::<(), weaver_codec::CodecError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Codebook {
    /// The codes, `[K, D]`.
    pub codes: Vec<f64>,
    /// Numbers of a code, `D`.
    pub dimensions: usize,
}

impl Codebook {
    /// Fits codes to vectors, `[N, D]`, that matter as much as `importance`, `[N]`, says.
    ///
    /// In each round every vector belongs to the nearest code, the first of equally near ones. Mass and sum of a code
    /// are moving averages with decay 0.8 over its vectors, and the code is their quotient. Codes without mass become
    /// the most important vectors that are not met exactly. The same bits at any number of threads.
    ///
    /// # Errors
    /// When lengths do not fit, there is no vector or no code, or a number is not finite or an importance negative.
    pub fn fit(
        vectors: &[f64],
        dimensions: usize,
        importance: &[f64],
        codes: usize,
        rounds: usize,
    ) -> Result<Self, CodecError> {
        check(vectors, dimensions, importance, codes)?;
        let row = |i: usize| &vectors[i * dimensions..][..dimensions];
        let mut order: Vec<usize> = (0..importance.len()).collect();
        order.sort_by(|&a, &b| importance[b].total_cmp(&importance[a]));
        // Spread over all ranks of importance.
        let start = |k: usize| row(order[k * order.len() / codes]).iter().copied();
        let mut book = Self { codes: (0..codes).flat_map(start).collect(), dimensions };
        let mut masses = vec![0.0; codes];
        let mut sums = vec![0.0; codes * dimensions];
        for _ in 0..rounds {
            let nearest: Vec<(usize, f64)> =
                (0..importance.len()).into_par_iter().map(|i| book.nearest_with_distance(row(i))).collect();
            let (mut mass, mut sum) = (vec![0.0; codes], vec![0.0; codes * dimensions]);
            for (i, &(code, _)) in nearest.iter().enumerate() {
                mass[code] += importance[i];
                let sum = &mut sum[code * dimensions..][..dimensions];
                sum.iter_mut().zip(row(i)).for_each(|(s, x)| *s += importance[i] * x);
            }
            let average = |old: &mut f64, new: f64| *old = DECAY * *old + (1.0 - DECAY) * new;
            masses.iter_mut().zip(mass).for_each(|(old, new)| average(old, new));
            sums.iter_mut().zip(sum).for_each(|(old, new)| average(old, new));
            let mut missed = order.iter().copied().filter(|&i| nearest[i].1 > 0.0);
            let rows = book.codes.chunks_exact_mut(dimensions).zip(sums.chunks_exact_mut(dimensions));
            for ((code, sum), mass) in rows.zip(&masses) {
                if *mass > DEAD {
                    code.iter_mut().zip(sum).for_each(|(code, sum)| *code = *sum / mass);
                } else if let Some(i) = missed.next() {
                    sum.fill(0.0);
                    code.copy_from_slice(row(i));
                }
            }
        }
        Ok(book)
    }

    /// Index of the code nearest to a vector, the first of equally near ones.
    pub fn nearest(&self, vector: &[f64]) -> usize {
        self.nearest_with_distance(vector).0
    }

    fn nearest_with_distance(&self, vector: &[f64]) -> (usize, f64) {
        let codes = self.codes.chunks_exact(self.dimensions).enumerate();
        codes.fold((0, f64::INFINITY), |best, (index, code)| {
            let distance = distance_below(best.1, code, vector);
            if distance < best.1 { (index, distance) } else { best }
        })
    }
}

/// Numbers of a distance after which it is compared with the nearest so far.
const AT_ONCE: usize = 8;

/// The squared distance of two vectors, or a part of it that is not below `limit`.
fn distance_below(limit: f64, a: &[f64], b: &[f64]) -> f64 {
    let mut distance = 0.0;
    for (a, b) in a.chunks(AT_ONCE).zip(b.chunks(AT_ONCE)) {
        distance += a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
        if distance >= limit {
            break;
        }
    }
    distance
}

fn check(vectors: &[f64], dimensions: usize, importance: &[f64], codes: usize) -> Result<(), CodecError> {
    if dimensions == 0 || codes == 0 || importance.is_empty() {
        let found = format!("{dimensions}, {codes} and {}", importance.len());
        return Err(CodecError::invalid("codebook", "at least one dimension, one code and one vector", found));
    }
    if vectors.len() != dimensions * importance.len() {
        let expected = format!("{} numbers", dimensions * importance.len());
        return Err(CodecError::invalid("vectors", expected, vectors.len()));
    }
    if let Some(at) = vectors.iter().position(|x| !x.is_finite()) {
        return Err(CodecError::invalid(format!("vector {}", at / dimensions), "finite numbers", vectors[at]));
    }
    match importance.iter().position(|w| !(w.is_finite() && *w >= 0.0)) {
        Some(at) => Err(CodecError::invalid(format!("importance {at}"), "zero or more", importance[at])),
        None => Ok(()),
    }
}
