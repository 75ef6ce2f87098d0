//! Probabilities of matches, from the last states of the keypoints of two photos.

use super::LearnedMatch;
use weaver_kernels::exp::exp_f32;
use weaver_kernels::gemm::{Mat, MatMut, gemm};
use weaver_kernels::parallel::for_chunks;

/// The keypoints of a photo.
pub(super) struct Side {
    /// Logits of having a match.
    pub logits: Vec<f32>,
    /// `[n, width]`.
    pub states: Vec<f32>,
    pub numbers: Vec<u32>,
}

/// The keypoints that are each other's most probable match, with a probability above `least`, by falling probability.
///
/// The logarithm of the probability is `log_softmax(s, 1) + log_softmax(s, 0) + log_sigmoid(a) + log_sigmoid(b)`, with
/// similarities s `[n, m]` and logits a `[n]` and b `[m]` of having a match.
pub(super) fn assigned(first: &Side, second: &Side, least: f32) -> Vec<LearnedMatch> {
    let (n, m) = (first.numbers.len(), second.numbers.len());
    if n == 0 || m == 0 {
        return Vec::new();
    }
    let width = first.states.len() / n;
    let mut scores = vec![0.0; n * m];
    let [a, b] = [Mat::new(&first.states, n, width), Mat::new(&second.states, m, width).transposed()];
    gemm(1.0 / (width as f32).sqrt(), a, b, 0.0, MatMut::new(&mut scores, n, m));
    let mut of_rows = vec![0.0; n];
    for_chunks(&mut of_rows, 1, |i, out| out[0] = log_sum(scores[i * m..][..m].iter().copied()));
    let mut tops = vec![f32::NEG_INFINITY; m];
    scores.chunks_exact(m).for_each(|row| tops.iter_mut().zip(row).for_each(|(top, x)| *top = top.max(*x)));
    let mut sums = vec![0.0; m];
    for row in scores.chunks_exact(m) {
        (sums.iter_mut().zip(&tops).zip(row)).for_each(|((sum, top), x)| *sum += exp_f32(x - top));
    }
    let of_columns: Vec<f32> = tops.iter().zip(&sums).map(|(top, sum)| top + sum.ln()).collect();
    let [a, b] = [first, second].map(|side| side.logits.iter().map(|x| log_sigmoid(*x)).collect::<Vec<f32>>());
    for_chunks(&mut scores, m, |i, row| {
        let of_row = of_rows[i] - a[i];
        (row.iter_mut().zip(&of_columns).zip(&b))
            .for_each(|((x, of_column), b)| *x = 2.0 * *x - of_column - of_row + b);
    });
    let mut best_of_columns = vec![(f32::NEG_INFINITY, 0); m];
    for (i, row) in scores.chunks_exact(m).enumerate() {
        for (best, x) in best_of_columns.iter_mut().zip(row) {
            if *x > best.0 {
                *best = (*x, i);
            }
        }
    }
    let mut found = Vec::new();
    for (i, row) in scores.chunks_exact(m).enumerate() {
        let best = row
            .iter()
            .enumerate()
            .fold((f32::NEG_INFINITY, 0), |best, (j, x)| if *x > best.0 { (*x, j) } else { best });
        let score = exp_f32(best.0);
        if best_of_columns[best.1].1 == i && score > least {
            found.push(LearnedMatch { first: first.numbers[i], second: second.numbers[best.1], score });
        }
    }
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    found
}

/// ln of the sum of exponentials.
fn log_sum(values: impl Iterator<Item = f32> + Clone) -> f32 {
    let top = values.clone().fold(f32::NEG_INFINITY, f32::max);
    top + values.map(|x| exp_f32(x - top)).sum::<f32>().ln()
}

fn log_sigmoid(x: f32) -> f32 {
    x.min(0.0) - (-x.abs()).exp().ln_1p()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two keypoints of each photo that are clearly the same; a third one of the second photo is like none.
    #[test]
    fn each_others_best_are_matched() {
        let side = |states: &[[f32; 2]]| Side {
            logits: vec![9.0; states.len()],
            states: states.concat(),
            numbers: (10..10 + states.len() as u32).collect(),
        };
        let first = side(&[[9.0, 0.0], [0.0, 9.0]]);
        let second = side(&[[0.0, 9.0], [-9.0, -9.0], [9.0, 0.0]]);
        let found: Vec<[u32; 2]> = assigned(&first, &second, 0.1).iter().map(|m| [m.first, m.second]).collect();
        assert_eq!(found.len(), 2);
        assert!(found.contains(&[10, 12]) && found.contains(&[11, 10]));
        assert!(assigned(&side(&[]), &second, 0.1).is_empty());
        // Logits of having no match are below the threshold.
        let doubtful = Side { logits: vec![-9.0; 2], ..side(&[[9.0, 0.0], [0.0, 9.0]]) };
        assert!(assigned(&doubtful, &second, 0.1).is_empty());
    }
}
