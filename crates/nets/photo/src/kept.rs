//! Places that several photos show are given Gaussians once.

use crate::prior::Transfer;
use weaver_geometry::Camera;
use weaver_kernels::parallel;

/// Two photos show the same place if logarithms of its depths differ by less than this, or by the sum of their spreads.
const SAME: f32 = 0.02;
/// The largest spread that is believed.
const WIDEST: f32 = 0.1;
/// The earlier of two photos keeps a place unless the later one is better by this factor.
const BETTER: f32 = 0.8;
/// Photos that see through a place to something behind before it is given up.
const THROUGH: usize = 2;
/// Part of the depth by which something is behind, at least.
const BEHIND: f32 = 0.08;

/// Depth maps of V photos of H x W pixels, with their uncertainty.
#[derive(Clone, Copy, Debug)]
pub struct DepthMaps<'a> {
    /// Log depth `[V, H, W]`.
    pub log_depth: &'a [f32],
    /// Logarithm of the spread of log depth `[V, H, W]`.
    pub log_spread: &'a [f32],
    /// The cameras, in the units of depth.
    pub cameras: &'a [Camera],
    /// Which pixels count `[V, H, W]`; `None` if all do.
    pub inside: Option<&'a [bool]>,
}

impl DepthMaps<'_> {
    /// Which pixels `[V, H, W]` are to get Gaussians: those whose place no other photo shows better, and which no two
    /// photos see through.
    ///
    /// A photo shows a place better that shows it larger, at a smaller spread: a pixel's size at its depth times 1 plus
    /// the spread over 2 %. Masked pixels are never kept, and make no other pixel go.
    pub fn kept(&self) -> Vec<bool> {
        let views = self.cameras.len();
        let pixels = self.log_depth.len() / views.max(1);
        let mut kept = vec![true; self.log_depth.len()];
        parallel::for_chunks(&mut kept, pixels.max(1), |view, kept| {
            let others: Vec<(usize, Transfer<'_>)> = (0..views)
                .filter(|other| *other != view)
                .map(|other| (other, Transfer::new(&self.cameras[view], &self.cameras[other])))
                .collect();
            for (at, kept) in kept.iter_mut().enumerate() {
                *kept = self.counts(view * pixels + at) && self.is_kept(view * pixels + at, view, &others);
            }
        });
        kept
    }

    fn counts(&self, at: usize) -> bool {
        self.inside.is_none_or(|inside| inside[at])
    }

    fn spread(&self, at: usize) -> f32 {
        self.log_spread[at].exp().min(WIDEST)
    }

    /// The size of a pixel at its depth, larger where the depth is unsure: the smallest shows a place best.
    fn badness(&self, at: usize, view: usize) -> f32 {
        self.log_depth[at].exp() / self.cameras[view].intrinsics.fx as f32 * (1.0 + self.spread(at) / SAME)
    }

    fn is_kept(&self, at: usize, view: usize, others: &[(usize, Transfer<'_>)]) -> bool {
        let pixels = self.log_depth.len() / self.cameras.len();
        let (own, mut through) = (self.badness(at, view), 0);
        for (other, there) in others {
            let Some(seen) = there.pixel(at % pixels, self.log_depth[at]).filter(|seen| seen.inside) else { continue };
            let theirs = other * pixels + seen.index();
            if !self.counts(theirs) {
                continue;
            }
            let behind = self.log_depth[theirs] - seen.depth.ln() as f32;
            let spreads = self.spread(at) + self.spread(theirs);
            if behind.abs() < SAME.max(spreads) {
                let needed = if *other < view { own / BETTER } else { own * BETTER };
                if self.badness(theirs, *other) < needed {
                    return false;
                }
            }
            // What a photo sees behind counts where it is surer of that than this one of its place.
            through += usize::from(behind > BEHIND.max(spreads) && self.spread(theirs) < self.spread(at));
        }
        through < THROUGH
    }
}
