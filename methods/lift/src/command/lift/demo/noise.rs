//! Wrong masks: two things that share one mask in half of the views.

use super::stage::Stage;
use crate::metrics::cosine;
use crate::{
    AggregateOptions, ClusterOptions, HdbscanOptions, LiftError, LiftOptions, Maps, Mask, Raster, Solver, aggregate,
    cluster, lift, to_unit_length,
};
use weaver_kernels::random::Stream;

/// Numbers of a thing's feature.
const CHANNELS: usize = 64;
/// Least number of pixels of a thing's mask.
const LEAST_PIXELS: usize = 8;
/// Bounds on a mask's overlap with a cluster: the published one, and a lower one.
pub const BOUNDS: [f64; 2] = [0.8, 0.7];

#[derive(Clone, Debug)]
pub struct Noise {
    pub masks: Vec<Mask<f32>>,
    /// True for each mask of two things.
    pub wrong: Vec<bool>,
    /// Features of the splats before aggregation.
    pub features: Vec<f32>,
    /// Mean cosine of the two things' splats to their own feature, before aggregation.
    pub lifted: f64,
    /// Results, one for each of the [`BOUNDS`].
    pub cleaned: Vec<Cleaned>,
}

/// Effect of aggregation with one bound.
#[derive(Clone, Debug)]
pub struct Cleaned {
    pub kept: Vec<bool>,
    pub features: Vec<f32>,
    /// Part of the wrong masks that were rejected, and part of the rejected ones that were wrong.
    pub recall: f64,
    pub precision: f64,
    /// As [`Noise::lifted`], afterward, and with as many masks rejected by chance.
    pub cosine: f64,
    pub by_chance: f64,
}

impl Noise {
    pub fn of(stage: &Stage, seed: u64) -> Result<Self, LiftError> {
        let stream = Stream::new(seed, 0, "lift.demo.noise");
        let mut vectors: Vec<f32> = (0..stage.classes * CHANNELS).map(|i| stream.normal(i as u64)).collect();
        to_unit_length(&mut vectors, CHANNELS);
        let pair = largest_pair(stage);
        let (masks, wrong) = masks(stage, &vectors, pair);
        let mut maps = maps(stage, &masks);
        let mut raster = Raster::new(stage.splats.as_slices(), &stage.training.cameras, stage.settings);
        let options = LiftOptions { unit: true, ..LiftOptions::with(Solver::RowSum) };
        let lifted = lift(&mut raster, &mut maps, &options, &mut || ())?;
        let smallest = (stage.labels.len() / 100).max(5);
        let hdbscan = HdbscanOptions { smallest, ..HdbscanOptions::default() };
        let options = ClusterOptions { hdbscan, ..ClusterOptions::default() };
        let labels = cluster(&lifted.features, CHANNELS, &lifted.seen, &options)?;
        let cosine = |features: &[f32]| {
            let of_pair = (0..stage.labels.len()).filter(|j| pair.contains(&stage.labels[*j]) && lifted.seen[*j] > 0.0);
            let vector = |label: u32| &vectors[label as usize * CHANNELS..][..CHANNELS];
            let cosines: Vec<f64> =
                of_pair.map(|j| cosine(&features[j * CHANNELS..(j + 1) * CHANNELS], vector(stage.labels[j]))).collect();
            cosines.iter().sum::<f64>() / cosines.len().max(1) as f64
        };
        let mut cleaned = Vec::new();
        for overlap in BOUNDS {
            let mut features = lifted.features.clone();
            let options = AggregateOptions { overlap, ..AggregateOptions::default() };
            let kept = aggregate(&mut raster, &labels, &masks, &mut features, &options)?.kept;
            let rejected = kept.iter().filter(|kept| !**kept).count();
            let order = stream.fork(1).permutation(masks.len());
            let chosen: Vec<Mask<f32>> = order[rejected..].iter().map(|i| masks[*i].clone()).collect();
            let mut by_chance = lifted.features.clone();
            let any = AggregateOptions { overlap: -1.0, ..AggregateOptions::default() };
            aggregate(&mut raster, &labels, &chosen, &mut by_chance, &any)?;
            let both = wrong.iter().zip(&kept).filter(|(wrong, kept)| **wrong && !**kept).count() as f64;
            cleaned.push(Cleaned {
                recall: both / wrong.iter().filter(|wrong| **wrong).count().max(1) as f64,
                precision: both / rejected.max(1) as f64,
                cosine: cosine(&features),
                by_chance: cosine(&by_chance),
                kept,
                features,
            });
        }
        let before = cosine(&lifted.features);
        Ok(Self { masks, wrong, lifted: before, features: lifted.features, cleaned })
    }
}

/// Feature maps of the masks; zeros elsewhere.
fn maps(stage: &Stage, masks: &[Mask<f32>]) -> Maps<f32> {
    let mut views: Vec<Vec<f32>> = stage.training.ids.iter().map(|ids| vec![0.0; ids.len() * CHANNELS]).collect();
    for mask in masks {
        for pixel in &mask.pixels {
            views[mask.view][*pixel as usize * CHANNELS..][..CHANNELS].copy_from_slice(&mask.feature);
        }
    }
    Maps { views, channels: CHANNELS }
}

/// Of the four largest things beside the ground the two neighbors by size that are most alike: a mask of both is then
/// clearly larger than either.
fn largest_pair(stage: &Stage) -> [u32; 2] {
    let mut sizes = vec![0_u32; stage.classes];
    stage.training.ids.iter().flatten().for_each(|id| sizes[*id as usize] += 1);
    let mut things: Vec<u32> = (2..stage.classes as u32).collect();
    things.sort_by_key(|id| std::cmp::Reverse(sizes[*id as usize]));
    let alike = |pair: &&[u32]| f64::from(sizes[pair[1] as usize]) / f64::from(sizes[pair[0] as usize].max(1));
    let pairs = things[..things.len().min(4)].windows(2);
    pairs.max_by(|a, b| alike(a).total_cmp(&alike(b))).map_or([1, 2], |pair| [pair[0], pair[1]])
}

/// One mask per thing and view; in every second view, the pair has one mask, with the unit sum of both features.
fn masks(stage: &Stage, vectors: &[f32], pair: [u32; 2]) -> (Vec<Mask<f32>>, Vec<bool>) {
    let vector = |id: u32| vectors[id as usize * CHANNELS..][..CHANNELS].to_vec();
    let (mut masks, mut wrong) = (Vec::new(), Vec::new());
    for (view, ids) in stage.training.ids.iter().enumerate() {
        let pixels = |of: &[u32]| -> Vec<u32> {
            (0..ids.len() as u32).filter(|pixel| of.contains(&ids[*pixel as usize])).collect()
        };
        let both_seen = pair.iter().all(|id| pixels(&[*id]).len() >= LEAST_PIXELS);
        let joined = view % 2 == 1 && both_seen;
        for id in 1..stage.classes as u32 {
            let (of, feature) = match joined && pair.contains(&id) {
                true if id == pair[0] => {
                    let mut sum: Vec<f32> = vector(pair[0]).iter().zip(vector(pair[1])).map(|(a, b)| a + b).collect();
                    to_unit_length(&mut sum, CHANNELS);
                    (pair.to_vec(), sum)
                }
                true => continue,
                false => (vec![id], vector(id)),
            };
            let pixels = pixels(&of);
            if pixels.len() >= LEAST_PIXELS {
                masks.push(Mask { view, pixels, feature });
                wrong.push(of.len() > 1);
            }
        }
    }
    (masks, wrong)
}
