//! Own features of photos, and learned ones behind them.

use super::PairMatcher;
use crate::descriptor::DESCRIPTOR;
use crate::features::{Features, Keypoint};
use crate::learned::{LearnedFeatures, LearnedMatch, nearest_matches};
use crate::matching::Match;
use crate::photo::Photo;
use std::cmp::Reverse;
use weaver_geometry::glam::DVec2;
use weaver_kernels::parallel;

/// Deviation of a learned keypoint, in pixels as the network sees a photo: it names a pixel.
const SCALE: f64 = 1.5;
/// Fewer matches than this may be chance.
const FEWEST: usize = 12;
/// Ratios of own matches end where the ratios of learned ones end, so that the clear ones of both are linked first.
const CLEAREST: f32 = 0.5;
const LEAST_CLEAR: f32 = 0.85;

/// Two photos and their matches.
pub(super) type Matched = ([usize; 2], Vec<Match>);

/// Features of photos; some have learned keypoints behind their own.
pub(super) struct Extended {
    /// Learned keypoints have empty descriptors, which match nothing.
    pub features: Vec<Features>,
    own: Vec<usize>,
    learned: Vec<Option<LearnedFeatures>>,
}

impl Extended {
    /// Learned features for the photos that are `wanted`.
    pub fn new(own: &[Features], photos: &[&Photo<'_>], wanted: &[bool], matcher: &dyn PairMatcher) -> Self {
        let mut learned: Vec<Option<LearnedFeatures>> = vec![None; own.len()];
        parallel::for_chunks(&mut learned, 1, |i, learned| {
            learned[0] = wanted[i].then(|| matcher.features_of(photos[i]));
        });
        let features = own.iter().zip(&learned).map(|(own, learned)| {
            let mut all = own.clone();
            all.keypoints.extend(learned.iter().flat_map(keypoints));
            all.descriptors.resize(all.keypoints.len() * DESCRIPTOR, 0);
            all
        });
        Self { features: features.collect(), own: own.iter().map(|f| f.keypoints.len()).collect(), learned }
    }

    /// The most similar of these pairs: of each photo that `looks` for some, about `most`, those with more matches by
    /// descriptors first.
    pub fn promising(&self, pairs: &[[usize; 2]], looks: &[bool], most: usize) -> Vec<[usize; 2]> {
        let mut common = vec![0; pairs.len()];
        parallel::for_chunks(&mut common, 1, |i, common| common[0] = self.nearest(pairs[i]).len());
        let mut order: Vec<usize> = (0..pairs.len()).filter(|i| common[*i] >= FEWEST).collect();
        order.sort_by_key(|i| (Reverse(common[*i]), pairs[*i]));
        let mut taken = vec![0; self.own.len()];
        let mut chosen = Vec::new();
        for pair in order.into_iter().map(|i| pairs[i]) {
            if pair.iter().any(|photo| looks[*photo] && taken[*photo] < most) {
                pair.iter().for_each(|photo| taken[*photo] += 1);
                chosen.push(pair);
            }
        }
        chosen.sort_unstable();
        chosen
    }

    /// Matches of pairs by the matcher; pairs with few are left out.
    pub fn matched(&self, pairs: &[[usize; 2]], matcher: &dyn PairMatcher) -> Vec<Matched> {
        self.matches(pairs, |pair| match pair.map(|photo| self.learned[photo].as_ref()) {
            [Some(first), Some(second)] => matcher.matches_of(first, second),
            _ => Vec::new(),
        })
    }

    /// Matches of pairs by descriptors alone; pairs with few are left out.
    pub fn nearest_matched(&self, pairs: &[[usize; 2]]) -> Vec<Matched> {
        self.matches(pairs, |pair| self.nearest(pair))
    }

    fn nearest(&self, pair: [usize; 2]) -> Vec<LearnedMatch> {
        match pair.map(|photo| self.learned[photo].as_ref()) {
            [Some(first), Some(second)] => nearest_matches(first, second),
            _ => Vec::new(),
        }
    }

    fn matches(&self, pairs: &[[usize; 2]], find: impl Fn([usize; 2]) -> Vec<LearnedMatch> + Sync) -> Vec<Matched> {
        let mut found: Vec<Matched> = pairs.iter().map(|pair| (*pair, Vec::new())).collect();
        parallel::for_chunks(&mut found, 1, |_, found| {
            let ([a, b], matches) = &mut found[0];
            let behind = |m: LearnedMatch| Match {
                first: self.own[*a] as u32 + m.first,
                second: self.own[*b] as u32 + m.second,
                ratio: LEAST_CLEAR - (LEAST_CLEAR - CLEAREST) * m.score,
            };
            *matches = find([*a, *b]).into_iter().map(behind).collect();
        });
        found.retain(|(_, matches)| matches.len() >= FEWEST);
        found
    }
}

fn keypoints(learned: &LearnedFeatures) -> impl Iterator<Item = Keypoint> {
    let pixel = learned.pixel.map(f64::from);
    // Centers of pixels are at .5 here.
    let place = move |[x, y]: &[f32; 2]| DVec2::new(f64::from(*x) + 0.5 * pixel[0], f64::from(*y) + 0.5 * pixel[1]);
    learned.points.iter().zip(&learned.scores).map(move |(point, score)| Keypoint {
        pixel: place(point),
        scale: SCALE * pixel[0].max(pixel[1]),
        angle: 0.0,
        contrast: *score,
    })
}
