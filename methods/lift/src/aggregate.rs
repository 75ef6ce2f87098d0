//! One feature for each cluster, from masks that agree with it.

use crate::error::{LiftError, expect_len};
use crate::lift::to_unit_length;
use crate::operator::Operator;
use crate::passes::for_rows;
use std::collections::BTreeMap;
use weaver_kernels::{Real, parallel};

/// A mask of a view, and the feature of its pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Mask<T> {
    /// The view.
    pub view: usize,
    /// Its pixels, each once.
    pub pixels: Vec<u32>,
    /// `[F]`
    pub feature: Vec<T>,
}

/// Agreement of masks with clusters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AggregateOptions {
    /// Bound on the overlap of a kept mask with its majority cluster: intersection over union of pixels.
    pub overlap: f64,
    /// Clusters drawn at a time; bounds memory.
    pub block: usize,
}

impl Default for AggregateOptions {
    fn default() -> Self {
        Self { overlap: 0.8, block: 64 }
    }
}

/// Fate of masks and clusters.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Aggregation {
    /// Intersection over union of each mask with its majority cluster; 0 for a majority of noise.
    pub overlaps: Vec<f64>,
    /// Fate of each mask, true if kept.
    pub kept: Vec<bool>,
    /// Number of clusters.
    pub clusters: usize,
    /// Clusters without a kept mask.
    pub without: usize,
}

/// The label of each pixel of each view: the largest of the drawn one-hot labels, 0 for noise and empty pixels, else
/// the cluster's number plus one.
///
/// # Errors
/// Lengths that do not fit, and errors of drawing.
pub fn label_maps<T: Real>(
    operator: &mut impl Operator<T>,
    labels: &[Option<u32>],
    block: usize,
) -> Result<Vec<Vec<u32>>, LiftError> {
    expect_len("labels", labels.len(), operator.splats())?;
    let channel = |label: &Option<u32>| label.map_or(0, |label| label as usize + 1);
    let channels = labels.iter().map(channel).max().unwrap_or(0) + 1;
    let block = block.clamp(1, channels);
    let mut maps: Vec<Vec<u32>> = (0..operator.views()).map(|view| vec![0; operator.rays(view)]).collect();
    let mut largest: Vec<Vec<T>> = maps.iter().map(|map| vec![T::ZERO; map.len()]).collect();
    for first in (0..channels).step_by(block) {
        let width = block.min(channels - first);
        let mut one_hot = vec![T::ZERO; labels.len() * width];
        for (label, row) in labels.iter().zip(one_hot.chunks_exact_mut(width)) {
            if let Some(x) = channel(label).checked_sub(first).and_then(|at| row.get_mut(at)) {
                *x = T::ONE;
            }
        }
        for (view, (map, largest)) in maps.iter_mut().zip(&mut largest).enumerate() {
            let mut drawn = vec![T::ZERO; map.len() * width];
            operator.forward(view, &one_hot, width, &mut drawn)?;
            parallel::for_chunks2(map, 1024, largest, 1024, |chunk, map, largest| {
                let rows = drawn[chunk * 1024 * width..].chunks_exact(width);
                for ((label, most), row) in map.iter_mut().zip(largest).zip(rows) {
                    for (c, x) in row.iter().enumerate().filter(|(_, x)| **x > T::ZERO) {
                        if *x > *most {
                            (*label, *most) = ((first + c) as u32, *x);
                        }
                    }
                }
            });
        }
    }
    Ok(maps)
}

/// Gives each cluster's Gaussians the mean feature of the masks that agree with it, in place: `features` `[P, F]`.
///
/// A mask belongs to the most frequent label of its pixels in the view's [`label_maps`], and is kept if it overlaps
/// enough with all of the view's pixels of that label. Noise and clusters without masks keep their features. Rows are
/// divided by their lengths at the end.
///
/// # Errors
/// Lengths that do not fit, masks of views or pixels that do not exist, and errors of drawing.
///
/// # Source
/// Xiong et al., Splat Feature Solver, 2026: a means to better figures, which is not a solution of the linear system.
pub fn aggregate<T: Real>(
    operator: &mut impl Operator<T>,
    labels: &[Option<u32>],
    masks: &[Mask<T>],
    features: &mut [T],
    options: &AggregateOptions,
) -> Result<Aggregation, LiftError> {
    let channels = features.len() / labels.len().max(1);
    expect_len("features", features.len(), labels.len() * channels)?;
    let maps = label_maps(operator, labels, options.block)?;
    let clusters = labels.iter().flatten().max().map_or(0, |most| *most as usize + 1);
    let mut sizes: Vec<BTreeMap<u32, usize>> = vec![BTreeMap::new(); maps.len()];
    for (map, sizes) in maps.iter().zip(&mut sizes) {
        map.iter().for_each(|label| *sizes.entry(*label).or_default() += 1);
    }
    let (mut sums, mut counts) = (vec![0.0; clusters * channels], vec![0_usize; clusters]);
    let (mut overlaps, mut kept) = (Vec::with_capacity(masks.len()), Vec::with_capacity(masks.len()));
    for mask in masks {
        expect_len("feature of a mask", mask.feature.len(), channels)?;
        let map = maps.get(mask.view).map_or(&[][..], Vec::as_slice);
        let most = mask.pixels.iter().max().map_or(0, |most| *most as usize + 1);
        if most > map.len() {
            return Err(LiftError::Length { what: "pixels of a mask", expected: map.len(), found: most });
        }
        let found = sizes.get(mask.view).and_then(|sizes| shown(mask, map, sizes));
        let overlap = found.map_or(0.0, |(_, overlap)| overlap);
        let cluster = found.filter(|(_, overlap)| *overlap > options.overlap).map(|(cluster, _)| cluster);
        if let Some(cluster) = cluster {
            counts[cluster] += 1;
            let sum = sums[cluster * channels..][..channels].iter_mut();
            sum.zip(&mask.feature).for_each(|(sum, x)| *sum += x.to_f64());
        }
        overlaps.push(overlap);
        kept.push(cluster.is_some());
    }
    for_rows(features, channels.max(1), |j, row| {
        let Some(cluster) = labels[j].map(|label| label as usize).filter(|cluster| counts[*cluster] > 0) else {
            return;
        };
        for (x, sum) in row.iter_mut().zip(&sums[cluster * channels..]) {
            *x = T::from_f64(sum / counts[cluster] as f64);
        }
    });
    to_unit_length(features, channels.max(1));
    let without = counts.iter().filter(|count| **count == 0).count();
    Ok(Aggregation { overlaps, kept, clusters, without })
}

/// The majority cluster of a mask, and their intersection over union; `None` for noise.
fn shown<T>(mask: &Mask<T>, map: &[u32], sizes: &BTreeMap<u32, usize>) -> Option<(usize, f64)> {
    let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
    mask.pixels.iter().for_each(|pixel| *counts.entry(map[*pixel as usize]).or_default() += 1);
    // Ties go to the smallest label.
    let (&label, &both) = counts.iter().rev().max_by_key(|(_, count)| **count)?;
    let either = mask.pixels.len() + sizes[&label] - both;
    Some(((label as usize).checked_sub(1)?, both as f64 / either as f64))
}
