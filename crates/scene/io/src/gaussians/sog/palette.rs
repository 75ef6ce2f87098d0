//! Rows of numbers as rows of a palette, by k-means in two levels.
//!
//! Against all of 65536 centers, a million rows would take hours. So rows are first divided among the square root of
//! that number of clusters, and each cluster is divided by itself: every row meets 512 centers.

use weaver_kernels::gemm::{Mat, MatMut, gemm_serial};
use weaver_kernels::parallel::for_chunks;

/// Rounds of improvement on each level.
const ROUNDS: usize = 8;
/// Rows from which the clusters of the first level are made.
const SAMPLE: usize = 1 << 16;
/// Rows of a parallel task.
const GRAIN: usize = 256;

/// Centers, and the one that each row belongs to.
pub(super) struct Palette {
    /// `[count, width]`.
    pub centers: Vec<f32>,
    /// `[N]`.
    pub labels: Vec<u32>,
}

impl Palette {
    /// At most `count` centers of rows `[N, width]`. The same rows give the same palette, at any number of threads.
    pub(super) fn of(rows: &[f32], width: usize, count: usize) -> Self {
        let n = rows.len() / width;
        let count = count.min(n);
        let first = (count as f64).sqrt().ceil() as usize;
        let step = n.div_ceil(SAMPLE).max(1);
        let sample: Vec<f32> = rows.chunks_exact(width).step_by(step).flatten().copied().collect();
        let coarse = clustered(&sample, width, first);
        let of = nearest(rows, width, &coarse);
        let mut members = vec![Vec::new(); first];
        of.iter().enumerate().for_each(|(i, cluster)| members[*cluster as usize].push(i));
        let mut palette = Self { centers: Vec::new(), labels: vec![0; n] };
        members.retain(|members| !members.is_empty());
        // Each cluster gets one center, and of those that are left its share by rows: no more than `count` in all.
        let (left, mut before) = (count - members.len(), 0);
        for members in &members {
            let share = |rows: usize| (rows as u128 * left as u128 / n as u128) as usize;
            let centers = share(before + members.len()) - share(before) + 1;
            before += members.len();
            let own: Vec<f32> = members.iter().flat_map(|i| &rows[i * width..][..width]).copied().collect();
            let fine = clustered(&own, width, centers);
            let start = (palette.centers.len() / width) as u32;
            for (i, label) in members.iter().zip(nearest(&own, width, &fine)) {
                palette.labels[*i] = start + label;
            }
            palette.centers.extend(fine);
        }
        palette
    }
}

/// `count` centers of rows, from rows that are evenly spaced among them (Lloyd, 1982).
fn clustered(rows: &[f32], width: usize, count: usize) -> Vec<f32> {
    let n = rows.len() / width;
    let count = count.min(n);
    let mut centers: Vec<f32> = (0..count).flat_map(|c| &rows[c * n / count * width..][..width]).copied().collect();
    if count == n {
        return centers;
    }
    for _ in 0..ROUNDS {
        let labels = nearest(rows, width, &centers);
        let (mut sums, mut sizes) = (vec![0.0_f64; centers.len()], vec![0_u32; count]);
        for (row, label) in rows.chunks_exact(width).zip(labels) {
            let label = label as usize;
            sizes[label] += 1;
            sums[label * width..][..width].iter_mut().zip(row).for_each(|(sum, x)| *sum += f64::from(*x));
        }
        for (c, size) in sizes.iter().enumerate().filter(|(_, size)| **size > 0) {
            let mean = sums[c * width..][..width].iter().map(|sum| (sum / f64::from(*size)) as f32);
            centers[c * width..][..width].iter_mut().zip(mean).for_each(|(center, mean)| *center = mean);
        }
    }
    centers
}

/// The nearest center of each row, of equally near ones the first.
fn nearest(rows: &[f32], width: usize, centers: &[f32]) -> Vec<u32> {
    let count = centers.len() / width;
    // |x - c|^2 / 2 without |x|^2 / 2, which is the same for all centers.
    let halves: Vec<f32> = centers.chunks_exact(width).map(|c| 0.5 * c.iter().map(|x| x * x).sum::<f32>()).collect();
    let mut labels = vec![0; rows.len() / width];
    for_chunks(&mut labels, GRAIN, |chunk, labels| {
        let rows = &rows[chunk * GRAIN * width..][..labels.len() * width];
        let mut products = vec![0.0; labels.len() * count];
        let (a, b) = (Mat::new(rows, labels.len(), width), Mat::new(centers, count, width).transposed());
        gemm_serial(1.0, a, b, 0.0, MatMut::new(&mut products, labels.len(), count));
        for (label, products) in labels.iter_mut().zip(products.chunks_exact(count)) {
            let distances = halves.iter().zip(products).map(|(half, product)| half - product).enumerate();
            let least = distances.fold((0, f32::INFINITY), |best, (c, d)| if d < best.1 { (c, d) } else { best });
            *label = least.0 as u32;
        }
    });
    labels
}

#[cfg(test)]
mod tests {
    use super::Palette;

    /// Most rows are in one place, so that shares of the other clusters are less than one center.
    #[test]
    fn there_are_no_more_centers_than_asked_for() {
        let rows: Vec<f32> = (0..400).map(|i| if i < 340 { 1e-4 * i as f32 } else { 10.0 * i as f32 }).collect();
        for count in [1, 2, 3, 5, 16, 17, 50, 64, 100, 399, 400, 1000] {
            let Palette { centers, labels } = Palette::of(&rows, 1, count);
            assert!(!centers.is_empty() && centers.len() <= count, "{} of {count}", centers.len());
            assert!(labels.iter().all(|label| (*label as usize) < centers.len()));
        }
        assert!(Palette::of(&[], 3, 8).labels.is_empty());
    }
}
