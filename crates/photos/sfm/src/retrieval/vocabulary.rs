//! Words for descriptors of keypoints: cells of a k-means tree of two levels.

use crate::descriptor::{DESCRIPTOR, LENGTH};
use crate::features::Features;
use weaver_kernels::gemm::{Mat, MatMut, gemm_serial};
use weaver_kernels::parallel;

/// Descriptors, of all photos, that a vocabulary is made of.
const SAMPLES: usize = 1 << 16;
/// Keypoints of a photo that are quantized: the ones with the most contrast.
const KEYPOINTS: usize = 4000;
/// Cells of the first level.
const CELLS: usize = 64;
/// Words of a cell, at most.
const WORDS: usize = 256;
/// Samples for each word, on average; few are enough, as neighboring words do no harm.
const SAMPLES_OF_WORD: usize = 4;
/// Steps of k-means.
const STEPS: usize = 6;
/// Descriptors that are compared with all centers at once.
const ROWS: usize = 128;

/// The descriptors of some keypoints as numbers, `[N, 128]`, of length 1.
fn descriptors(features: &Features, keypoints: impl Iterator<Item = usize>) -> Vec<f32> {
    let of = |i: usize| &features.descriptors[DESCRIPTOR * i..][..DESCRIPTOR];
    keypoints.flat_map(of).map(|x| f32::from(*x) / LENGTH).collect()
}

/// Centers, each the representative of the descriptors nearest to it.
#[derive(Clone, Debug, Default)]
struct Codebook {
    /// `[K, 128]`.
    centers: Vec<f32>,
    /// Half of their squared lengths.
    halves: Vec<f32>,
}

impl Codebook {
    /// The `count` means (at most as many as there are samples) of Lloyd's k-means, from evenly spaced samples.
    fn of(samples: &[f32], count: usize) -> Self {
        let n = samples.len() / DESCRIPTOR;
        let count = count.min(n);
        let centers = (0..count).flat_map(|k| &samples[k * n / count * DESCRIPTOR..][..DESCRIPTOR]).copied().collect();
        let mut book = Self::around(centers);
        let mut nearest = vec![0; n];
        for _ in 0..STEPS {
            book.nearest(samples, &mut nearest);
            let mut sums = vec![0.0; count * DESCRIPTOR];
            let mut members = vec![0_u32; count];
            for (sample, center) in samples.chunks_exact(DESCRIPTOR).zip(&nearest) {
                members[*center as usize] += 1;
                let sum = &mut sums[*center as usize * DESCRIPTOR..][..DESCRIPTOR];
                sum.iter_mut().zip(sample).for_each(|(sum, x)| *sum += x);
            }
            let old = book.centers.chunks_exact(DESCRIPTOR);
            for ((center, old), members) in sums.chunks_exact_mut(DESCRIPTOR).zip(old).zip(members) {
                match members {
                    // A center that is nearest to nothing stays in place.
                    0 => center.copy_from_slice(old),
                    members => center.iter_mut().for_each(|x| *x /= members as f32),
                }
            }
            book = Self::around(sums);
        }
        book
    }

    fn around(centers: Vec<f32>) -> Self {
        let half = |center: &[f32]| 0.5 * center.iter().map(|x| x * x).sum::<f32>();
        Self { halves: centers.chunks_exact(DESCRIPTOR).map(half).collect(), centers }
    }

    /// The number of the center nearest to each descriptor; of equal ones the first.
    fn nearest(&self, descriptors: &[f32], nearest: &mut [u32]) {
        let count = self.halves.len();
        let centers = Mat::new(&self.centers, count, DESCRIPTOR).transposed();
        parallel::for_chunks(nearest, ROWS, |chunk, nearest| {
            let rows = Mat::new(&descriptors[chunk * ROWS * DESCRIPTOR..], nearest.len(), DESCRIPTOR);
            let mut products = vec![0.0; nearest.len() * count];
            gemm_serial(1.0, rows, centers, 0.0, MatMut::new(&mut products, nearest.len(), count));
            for (nearest, products) in nearest.iter_mut().zip(products.chunks_exact(count)) {
                let mut top = (0, f32::NEG_INFINITY);
                for (k, (product, half)) in products.iter().zip(&self.halves).enumerate() {
                    if product - half > top.1 {
                        top = (k as u32, product - half);
                    }
                }
                *nearest = top.0;
            }
        });
    }
}

/// Words for descriptors: the nearest of some cells, then the nearest word of that cell.
#[derive(Clone, Debug, Default)]
pub(super) struct Vocabulary {
    cells: Codebook,
    words: Vec<Codebook>,
    /// The number of each cell's first word, and of all words at the end.
    first: Vec<u32>,
}

impl Vocabulary {
    /// The vocabulary of some photos, from a sample of their keypoints.
    pub fn of<'a>(photos: impl Iterator<Item = &'a Features> + Clone) -> Self {
        let each = (SAMPLES / photos.clone().count().max(1)).max(1);
        let sample = |features: &'a Features| {
            let n = features.keypoints.len();
            let taken = n.min(each);
            descriptors(features, (0..taken).map(|i| i * n / taken))
        };
        let samples: Vec<f32> = photos.flat_map(sample).collect();
        let n = samples.len() / DESCRIPTOR;
        if n == 0 {
            return Self::default();
        }
        let cells = Codebook::of(&samples, CELLS);
        let mut of = vec![0; n];
        cells.nearest(&samples, &mut of);
        let mut words = vec![Codebook::default(); cells.halves.len()];
        parallel::for_chunks(&mut words, 1, |cell, words| {
            let members = samples.chunks_exact(DESCRIPTOR).zip(&of).filter(|(_, of)| **of as usize == cell);
            let members: Vec<f32> = members.flat_map(|(sample, _)| sample).copied().collect();
            words[0] = Codebook::of(&members, (n / (CELLS * SAMPLES_OF_WORD)).clamp(1, WORDS));
        });
        let mut first = vec![0];
        for book in &words {
            first.push(first[first.len() - 1] + book.halves.len() as u32);
        }
        Self { cells, words, first }
    }

    /// Number of words.
    pub fn len(&self) -> usize {
        self.first.last().map_or(0, |n| *n as usize)
    }

    /// The words of a photo, ascending, and how often each occurs.
    pub fn counts(&self, features: &Features) -> Vec<(u32, u32)> {
        let n = if self.len() == 0 { 0 } else { features.keypoints.len().min(KEYPOINTS) };
        let mut of = vec![0; n];
        self.cells.nearest(&descriptors(features, 0..n), &mut of);
        let mut found = Vec::with_capacity(n);
        for (cell, book) in self.words.iter().enumerate().filter(|(_, book)| !book.halves.is_empty()) {
            let members: Vec<usize> = (0..n).filter(|i| of[*i] as usize == cell).collect();
            let mut words = vec![0; members.len()];
            book.nearest(&descriptors(features, members.into_iter()), &mut words);
            found.extend(words.into_iter().map(|word| self.first[cell] + word));
        }
        found.sort_unstable();
        found.chunk_by(|a, b| a == b).map(|same| (same[0], same.len() as u32)).collect()
    }
}
