//! Matches by descriptors alone, a hundred times faster than the matcher.

use super::{LEARNED_DESCRIPTOR, LearnedFeatures, LearnedMatch};
use weaver_kernels::gemm::{Mat, MatMut, gemm_serial};

/// Similarity below which keypoints do not match, as in the original.
const ALIKE: f32 = 0.82;

/// Keypoints whose descriptors are each other's most similar ones, in the order of the first photo; scores are
/// similarities.
pub(crate) fn nearest_matches(first: &LearnedFeatures, second: &LearnedFeatures) -> Vec<LearnedMatch> {
    let (n, m) = (first.points.len(), second.points.len());
    let mut similar = vec![0.0; n * m];
    let [a, b] =
        [Mat::new(&first.descriptors, n, LEARNED_DESCRIPTOR), Mat::new(&second.descriptors, m, LEARNED_DESCRIPTOR)];
    gemm_serial(1.0, a, b.transposed(), 0.0, MatMut::new(&mut similar, n, m));
    let mut of_second = vec![(f32::NEG_INFINITY, 0); m];
    let mut of_first = vec![(f32::NEG_INFINITY, 0); n];
    for (i, row) in similar.chunks_exact(m.max(1)).enumerate() {
        for (j, (similar, best)) in row.iter().zip(&mut of_second).enumerate() {
            if *similar > best.0 {
                *best = (*similar, i);
            }
            if *similar > of_first[i].0 {
                of_first[i] = (*similar, j);
            }
        }
    }
    let mutual = of_first.iter().enumerate().filter(|(i, best)| best.0 > ALIKE && of_second[best.1].1 == *i);
    mutual.map(|(i, (score, j))| LearnedMatch { first: i as u32, second: *j as u32, score: *score }).collect()
}
