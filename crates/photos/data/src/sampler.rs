//! Sampling of views: training tuples, evaluation tuples, and samplers over ordered frames.

use crate::{Layout, Scene, Tuple};
use weaver_kernels::random::Stream;

/// Sampler of training tuples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampler {
    /// [`training_tuple`].
    Nearest {
        /// Number of its nearest training views that a view's context is drawn from.
        pool: usize,
    },
    /// Two training views with a bounded number of others between them in the order of paths, and random ones of these
    /// ([`bounded_gap`]): the two and the first ones between them are the context, the rest the targets. For videos, as
    /// published.
    BoundedGap,
    /// The context is spread evenly over the training views in the order of paths ([`uniform`]), the targets are random
    /// others.
    Uniform,
}

impl Sampler {
    /// Number `index` of an endless, random-access sequence of training tuples, of `context` and `targets` views;
    /// targets are repeated where there are not as many.
    ///
    /// # Panics
    /// If a scene has fewer than `context + 1` training views; see [`Scene::check_training`].
    pub fn tuple(self, scenes: &[Layout], rng: Stream, index: u64, context: usize, targets: usize) -> Tuple {
        if let Self::Nearest { pool } = self {
            return training_tuple(scenes, rng, index, pool, context, targets);
        }
        let rng = rng.fork(index);
        let scene = rng.below(0, scenes.len());
        let training = scenes[scene].training_views();
        let found = training.len();
        assert!(
            found > context,
            "scene {}: {found} training views cannot give {context} of context",
            scenes[scene].scene()
        );
        let mut chosen = match self {
            Self::Uniform => uniform(found, context),
            _ => bounded_gap(found, (context + targets).min(found), rng.fork(1)).expect("no more views than there are"),
        };
        let others: Vec<usize> = match self {
            Self::Uniform => rng.fork(2).permutation(found).into_iter().filter(|v| !chosen.contains(v)).collect(),
            _ => chosen.drain(context - 1..chosen.len() - 1).collect(),
        };
        let views = |places: &[usize]| -> Vec<usize> { places.iter().map(|place| training[*place]).collect() };
        let targets = others.iter().copied().cycle().take(targets).collect::<Vec<_>>();
        Tuple { scene, context: views(&chosen), targets: views(&targets) }
    }
}

/// Number `index` of an endless, random-access sequence of training tuples.
///
/// The scene and a training view `t` in it are drawn uniformly. The `pool` training views nearest to `t` are put in
/// random order: the first `context` of them are the context, the targets are `t` and those that follow (`t` again when
/// there are no more).
///
/// # Panics
/// If a scene has fewer than `context + 1` training views; see [`Scene::check_training`].
pub fn training_tuple(
    scenes: &[Layout],
    rng: Stream,
    index: u64,
    pool: usize,
    context: usize,
    targets: usize,
) -> Tuple {
    let rng = rng.fork(index);
    let scene = rng.below(0, scenes.len());
    let layout = &scenes[scene];
    let training = layout.training_views();
    let target = training[rng.below(1, training.len())];
    let near = layout.nearest(target, training, pool);
    assert!(
        near.len() >= context,
        "scene {}: {} training views within the pool of {pool} cannot give {context} of context",
        layout.scene(),
        near.len()
    );
    let shuffled: Vec<usize> = rng.fork(2).permutation(near.len()).into_iter().map(|i| near[i]).collect();
    let targets = std::iter::once(target)
        .chain(shuffled[context..].iter().copied())
        .chain(std::iter::repeat(target))
        .take(targets)
        .collect();
    Tuple { scene, context: shuffled[..context].to_vec(), targets }
}

/// The evaluation tuples of a scene, one per held-out view: the view is the target and its `context` nearest training
/// views, nearest first, are the context. `index` is the scene's index in its set.
pub fn evaluation_tuples(scene: &Scene, index: usize, context: usize) -> Vec<Tuple> {
    let layout = Layout::of(scene);
    let nearest = |view| layout.nearest(view, layout.training_views(), context);
    scene
        .held_out_views()
        .into_iter()
        .map(|view| Tuple { scene: index, context: nearest(view), targets: vec![view] })
        .collect()
}

/// Chooses `views` of `frames` ordered frames, spread evenly from the first to the last: `floor(i (n - 1) / (k - 1))`.
///
/// A single view is the first frame; asking for more views than frames repeats some.
///
/// ```
/// assert_eq!(weaver_data::uniform(10, 4), [0, 3, 6, 9]);
/// ```
pub fn uniform(frames: usize, views: usize) -> Vec<usize> {
    if frames == 0 {
        return Vec::new();
    }
    (0..views).map(|i| i * (frames - 1) / (views - 1).max(1)).collect()
}

/// Chooses `views` distinct frames of a video of `frames`: two ends that are a bounded number of frames apart, and
/// random frames between them in random order.
///
/// The distance between the ends is uniform in `[min(3n, 32), min(max(10n, n^2), 256)]` for `n` views, cut to the range
/// that the video and the number of views allow. `None` if the video is shorter than `views`.
pub fn bounded_gap(frames: usize, views: usize, rng: Stream) -> Option<Vec<usize>> {
    if views > frames {
        return None;
    }
    if views < 2 {
        return Some((0..views).map(|_| rng.below(0, frames)).collect());
    }
    let most = (10 * views).max(views * views).min(256).clamp(views - 1, frames - 1);
    let least = (3 * views).min(32).clamp(views - 1, most);
    let gap = least + rng.below(0, most - least + 1);
    let first = rng.below(1, frames - gap);
    let mut chosen = vec![first];
    chosen.extend(rng.fork(2).permutation(gap - 1).into_iter().take(views - 2).map(|i| first + 1 + i));
    chosen.push(first + gap);
    Some(chosen)
}
