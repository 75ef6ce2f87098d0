//! The region-adaptive hierarchical transform: orthonormal, of values at Morton-sorted voxels.

use crate::error::CodecError;
use weaver_kernels::Real;

/// One step: two neighbors with weights `w1`, `w2` become their mean and their difference.
#[derive(Clone, Copy, Debug)]
struct Merge {
    /// Index of the first, whose place the mean takes, and of the second, whose place the difference takes.
    pair: [usize; 2],
    /// `√w1 / √(w1 + w2)` and `√w2 / √(w1 + w2)`.
    cosine: f64,
    sine: f64,
}

/// The transform of a set of voxels (de Queiroz and Chou, 2016).
///
/// Bottom-up, neighbors `a1`, `a2` become `(√w1 a1 + √w2 a2, √w1 a2 - √w2 a1) / √(w1 + w2)`, the first with weight
/// `w1 + w2`. Energy is kept, and constant values end up in the first coefficient alone. Values are `[N, C]`, in
/// place: the coefficient at 0 is the mean of all, each other one the difference between its own region and the one
/// before.
///
/// ```
/// use weaver_codec::Raht;
///
/// let raht = Raht::new(&[0, 1, 9], &[1.0; 3])?;
/// let mut values = [2.0; 3];
/// raht.forward(&mut values, 1);
/// assert!((values[0] - 2.0 * 3.0_f64.sqrt()).abs() < 1e-12);
/// assert!(values[1].abs() < 1e-12 && values[2].abs() < 1e-12);
/// raht.inverse(&mut values, 1);
/// assert!((values[2] - 2.0).abs() < 1e-12);
/// # Ok::<(), weaver_codec::CodecError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Raht {
    voxels: usize,
    merges: Vec<Merge>,
}

impl Raht {
    /// The transform for voxels in Morton order, equal ones allowed, with positive weights.
    ///
    /// # Errors
    /// When voxels are not sorted, or a weight is missing or not positive.
    pub fn new(codes: &[u64], weights: &[f64]) -> Result<Self, CodecError> {
        if codes.len() != weights.len() {
            return Err(CodecError::invalid("weights of voxels", codes.len(), weights.len()));
        }
        if let Some(at) = codes.windows(2).position(|pair| pair[0] > pair[1]) {
            return Err(CodecError::invalid(format!("voxel {}", at + 1), "Morton order", codes[at + 1]));
        }
        if let Some(bad) = weights.iter().find(|w| !(w.is_finite() && **w > 0.0)) {
            return Err(CodecError::invalid("weights of voxels", "positive numbers", bad));
        }
        let mut nodes: Vec<(u64, f64, usize)> =
            codes.iter().zip(weights).enumerate().map(|(i, (c, w))| (*c, *w, i)).collect();
        let mut merges = Vec::with_capacity(codes.len().saturating_sub(1));
        while nodes.len() > 1 {
            let mut next: Vec<(u64, f64, usize)> = Vec::with_capacity(nodes.len());
            for &(code, weight, index) in &nodes {
                match next.last_mut() {
                    Some(last) if last.0 == code => {
                        let total = last.1 + weight;
                        let (cosine, sine) = ((last.1 / total).sqrt(), (weight / total).sqrt());
                        merges.push(Merge { pair: [last.2, index], cosine, sine });
                        last.1 = total;
                    }
                    _ => next.push((code, weight, index)),
                }
            }
            // To the smallest cell in which two of them meet.
            let apart = next.windows(2).map(|pair| (pair[0].0 ^ pair[1].0).leading_zeros()).max();
            let up = apart.map_or(0, |zeros| u64::BITS - zeros);
            for node in &mut next {
                node.0 = node.0.checked_shr(up).unwrap_or(0);
            }
            nodes = next;
        }
        Ok(Self { voxels: codes.len(), merges })
    }

    /// Indices of coefficients from the coarsest to the finest: the mean first, then differences of ever smaller cells.
    pub fn order(&self) -> Vec<usize> {
        let first = self.merges.last().map_or(0, |merge| merge.pair[0]);
        let finer = self.merges.iter().rev().map(|merge| merge.pair[1]);
        (self.voxels > 0).then_some(first).into_iter().chain(finer).collect()
    }

    /// Transforms values, `[N, C]`. Results are the same bits on every machine.
    ///
    /// # Panics
    /// When there are not `C` values for each voxel.
    pub fn forward<T: Real>(&self, values: &mut [T], channels: usize) {
        assert_eq!(values.len(), self.voxels * channels, "values of {} voxels", self.voxels);
        self.merges.iter().for_each(|merge| merge.turn(values, channels, merge.sine));
    }

    /// Transforms coefficients back, `[N, C]`.
    ///
    /// # Panics
    /// As [`Raht::forward`].
    pub fn inverse<T: Real>(&self, values: &mut [T], channels: usize) {
        assert_eq!(values.len(), self.voxels * channels, "values of {} voxels", self.voxels);
        self.merges.iter().rev().for_each(|merge| merge.turn(values, channels, -merge.sine));
    }
}

impl Merge {
    #[inline]
    fn turn<T: Real>(&self, values: &mut [T], channels: usize, sine: f64) {
        let (cosine, sine) = (T::from_f64(self.cosine), T::from_f64(sine));
        // The second one is always behind the first.
        let (before, behind) = values.split_at_mut(self.pair[1] * channels);
        let first = &mut before[self.pair[0] * channels..][..channels];
        for (x, y) in first.iter_mut().zip(&mut behind[..channels]) {
            let (a, b) = (*x, *y);
            *x = cosine * a + sine * b;
            *y = cosine * b - sine * a;
        }
    }
}
