//! Photos in drawn light, with passers-by: planted differences between photos of one place.

use crate::Example;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use weaver_data::{Scene, View};
use weaver_kernels::random::Stream;
use weaver_procedural::appearance::{Appearance, seen};

/// Light and passers-by that photos are given, beside what was photographed. Training draws them afresh for each tuple,
/// evaluation keeps one for each view, the same for every run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LooksConfig {
    /// Rectangles of one color in a photo: from none to so many.
    #[schemars(range(max = 100))]
    pub occluders: usize,
    /// True if the model is told which pixels they cover, so that no loss counts these and they get no Gaussians;
    /// `false` is for ablations.
    pub masks: bool,
    /// Built-in scenes only: the sun itself is elsewhere in every photo, so that shadows move, beside what is drawn.
    /// One embedding of a photo cannot tell that.
    pub moving_sun: bool,
}

impl Default for LooksConfig {
    fn default() -> Self {
        Self { occluders: 3, masks: true, moving_sun: false }
    }
}

impl LooksConfig {
    /// Gives an example's photos drawn looks. With masks, a pixel of a target counts where nothing covers it and a
    /// context photo shows the same (where depth is exact), or the sky.
    pub(crate) fn vary(&self, example: &mut Example, scene: &Scene, stream: Stream) {
        let size = [example.cameras[0].width, example.cameras[0].height];
        let pixels = size[0] * size[1];
        let context = example.tuple.context.clone();
        let views: Vec<usize> = context.iter().chain(&example.tuple.targets).copied().collect();
        let mut inside = example.inside.take().unwrap_or_else(|| vec![true; views.len() * pixels]);
        for (i, view) in views.iter().enumerate() {
            let drawn = Appearance::drawn(stream.fork(*view as u64), size, self.occluders);
            let counts = &mut inside[i * pixels..][..pixels];
            for (channel, plane) in example.images[3 * i * pixels..][..3 * pixels].chunks_mut(pixels).enumerate() {
                for (at, x) in plane.iter_mut().enumerate().filter(|(at, _)| counts[*at]) {
                    *x = drawn.of(*x, channel, [at % size[0], at / size[0]]);
                }
            }
            if self.masks {
                counts.iter_mut().zip(drawn.uncovered(size)).for_each(|(counts, uncovered)| *counts &= uncovered);
            }
        }
        if !self.masks {
            // Pixels masked for other reasons stay masked.
            example.inside = inside.contains(&false).then_some(inside);
            return;
        }
        let (of_context, of_targets) = inside.split_at_mut(context.len() * pixels);
        for (counts, target) in of_targets.chunks_mut(pixels).zip(&views[context.len()..]) {
            let shared = seen(scene, *target, &context, |i, at| of_context[i * pixels + at]);
            shared.iter().flatten().zip(counts).for_each(|(seen, counts)| *counts &= seen);
        }
        example.depth.iter_mut().zip(&*of_context).filter(|(_, inside)| !**inside).for_each(|(depth, _)| *depth = 0.0);
        example.inside = Some(inside);
    }

    /// The appearance of a view of an evaluation's scene: the same in every evaluation. `which` 0 is its own, others
    /// are further draws.
    pub(crate) fn of_view(&self, scene: usize, view: usize, which: u64, size: [usize; 2]) -> Appearance {
        let stream = Stream::new(0, scene as u64, "evaluated looks").fork(view as u64).fork(which);
        Appearance::drawn(stream, size, self.occluders)
    }

    /// An evaluation's scene with looks; pixels under a rectangle do not count.
    pub(crate) fn of_scene(&self, scene: &Scene, number: usize) -> Scene {
        let of_view = |(i, view): (usize, &View)| {
            let size = [view.image.width, view.image.height];
            let drawn = self.of_view(number, i, 0, size);
            let own = |at: usize| view.inside.as_ref().is_none_or(|inside| inside[at]);
            let uncovered = drawn.uncovered(size).into_iter().enumerate().map(|(at, uncovered)| uncovered && own(at));
            let inside = Some(uncovered.collect());
            View { image: drawn.photo(&view.image, view.inside.as_deref()), inside, ..view.clone() }
        };
        let views = scene.views.iter().enumerate().map(of_view).collect();
        Scene { views, ..scene.clone() }
    }
}
