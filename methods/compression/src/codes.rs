//! Rows that share the codes of a codebook, in training and in files.

use crate::CompressionError;
use crate::payload::broken;
use weaver_codec::Codebook;

/// Rounds of fitting.
const ROUNDS: usize = 10;

/// Least mean number of rows of a code: codes take bytes, too.
const ROWS: usize = 8;

/// Rows replaced by codes, with the code of each.
#[derive(Clone, Debug)]
pub(crate) struct Codes {
    /// The code of each row, `[N]`.
    pub(crate) of: Vec<u32>,
    /// Numbers of a row.
    width: usize,
    count: usize,
    weights: Vec<f64>,
}

impl Codes {
    /// Fits at most `most` codes to rows, `[N, width]`, weighted by `weights`, `[N]`.
    pub(crate) fn fit(rows: &[f32], width: usize, weights: &[f64], most: usize) -> Result<Self, CompressionError> {
        let wide: Vec<f64> = rows.iter().map(|x| f64::from(*x)).collect();
        let count = most.min(weights.len().div_ceil(ROWS)).max(1);
        // Invisible rows still have a code.
        let weights: Vec<f64> = weights.iter().map(|w| w.max(1e-6)).collect();
        let book = Codebook::fit(&wide, width, &weights, count, ROUNDS)?;
        let of = wide.chunks_exact(width).map(|row| book.nearest(row) as u32).collect();
        Ok(Self { of, width, count, weights })
    }

    /// Weighted means of the rows of each code, `[count, width]`; 0 for a code without rows.
    pub(crate) fn means(&self, rows: &[f32]) -> Vec<f32> {
        let (mut sums, mut masses) = (vec![0.0_f64; self.count * self.width], vec![0.0_f64; self.count]);
        for ((row, code), weight) in rows.chunks_exact(self.width).zip(&self.of).zip(&self.weights) {
            let sum = &mut sums[*code as usize * self.width..][..self.width];
            sum.iter_mut().zip(row).for_each(|(sum, x)| *sum += weight * f64::from(*x));
            masses[*code as usize] += weight;
        }
        let means = sums.chunks_exact(self.width).zip(&masses);
        means
            .flat_map(|(sum, mass)| sum.iter().map(move |s| if *mass > 0.0 { (s / mass) as f32 } else { 0.0 }))
            .collect()
    }

    /// The rows of codes, repeated for each index.
    pub(crate) fn spread(book: &[f32], width: usize, of: &[u32]) -> Result<Vec<f32>, CompressionError> {
        let mut rows = Vec::with_capacity(of.len() * width);
        for &code in of {
            let row = book.get(code as usize * width..(code as usize + 1) * width);
            rows.extend(row.ok_or_else(|| broken("code", format!("below {}", book.len() / width.max(1)), code))?);
        }
        Ok(rows)
    }

    /// Rows replaced by the means of their codes.
    pub(crate) fn rounded(&self, rows: &[f32]) -> Vec<f32> {
        let means = self.means(rows);
        self.of.iter().flat_map(|code| means[*code as usize * self.width..][..self.width].iter().copied()).collect()
    }

    /// Number of codes.
    pub(crate) fn count(&self) -> usize {
        self.count
    }
}

/// The harmonics beyond the first, `[N, 3 (K - 1)]`, from rows of all harmonics.
pub(crate) fn rest_of(sh: &[f32], coefficients: usize) -> Vec<f32> {
    sh.chunks_exact(3 * coefficients).flat_map(|row| row[3..].iter().copied()).collect()
}
