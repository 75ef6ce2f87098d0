//! Tuples and frame samplers.

use crate::scene::{line, view};
use proptest::prelude::*;
use std::collections::BTreeSet;
use weaver_data::{Layout, Sampler, Scene, Tuple, bounded_gap, evaluation_tuples, training_tuple, uniform};
use weaver_geometry::glam::DVec3;
use weaver_kernels::random::Stream;

#[test]
fn a_training_tuple_is_a_shuffle_of_the_nearest() {
    let scenes = [line(12), line(30)];
    let layouts: Vec<Layout> = scenes.iter().map(Layout::of).collect();
    let rng = Stream::new(1, 0, "test.tuples");
    let (mut first, mut targets) = (BTreeSet::new(), BTreeSet::new());
    for index in 0..400 {
        let tuple = training_tuple(&layouts, rng, index, 6, 4, 2);
        assert_eq!(tuple, training_tuple(&layouts, rng, index, 6, 4, 2));
        let scene = &scenes[tuple.scene];
        let training = scene.training_views();
        let pool = scene.nearest(tuple.targets[0], &training, 6);
        assert_eq!((tuple.context.len(), tuple.targets.len()), (4, 2));
        assert!(training.contains(&tuple.targets[0]));
        let others: BTreeSet<usize> = tuple.context.iter().chain(&tuple.targets[1..]).copied().collect();
        assert_eq!(others.len(), 5, "distinct views");
        assert!(others.iter().all(|view| pool.contains(view)));
        if tuple.scene == 1 {
            targets.insert(tuple.targets[0]);
            first.insert(pool.iter().position(|view| *view == tuple.context[0]));
        }
    }
    assert_eq!(targets.into_iter().collect::<Vec<_>>(), scenes[1].training_views());
    assert_eq!(first.len(), 6, "camera 0 is any of the pool");
}

/// A helix of cameras that look to all sides; every eighth held out. Pairs of them lie equally far apart.
fn helix(views: usize) -> Scene {
    let camera = |i: usize| {
        let turn = 0.05 * i as f64;
        view(&i.to_string(), DVec3::new(turn.cos(), 0.01 * (i / 2) as f64, turn.sin()), 1.7 * turn, i.is_multiple_of(8))
    };
    Scene { views: (0..views).map(camera).collect(), visible: vec![Vec::new(); views], ..line(0) }
}

/// The definition, as slow as it is: all separations from the cameras themselves, all sorted.
struct Slow {
    scene: Scene,
    median: f64,
}

impl Slow {
    fn of(scene: Scene) -> Self {
        let center = |v: usize| scene.views[v].camera.pose.center();
        let pairs = (0..scene.views.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
        let mut distances: Vec<f64> = pairs.map(|(a, b)| center(a).distance(center(b))).collect();
        distances.sort_by(f64::total_cmp);
        let n = distances.len();
        let median = if n % 2 == 1 { distances[n / 2] } else { (distances[n / 2 - 1] + distances[n / 2]) / 2.0 };
        Self { scene, median }
    }

    fn separation(&self, a: usize, b: usize) -> f64 {
        let [a, b] = [a, b].map(|v| &self.scene.views[v].camera.pose);
        a.center().distance(b.center()) / self.median + a.angle_to(b)
    }

    fn tuple(&self, rng: Stream, index: u64, pool: usize, context: usize) -> Tuple {
        let rng = rng.fork(index);
        let training = self.scene.training_views();
        let target = training[rng.below(1, training.len())];
        let mut near: Vec<usize> = training.into_iter().filter(|v| *v != target).collect();
        near.sort_by(|a, b| self.separation(target, *a).total_cmp(&self.separation(target, *b)));
        let order = rng.fork(2).permutation(pool.min(near.len()));
        let shuffled: Vec<usize> = order.into_iter().map(|i| near[i]).collect();
        let targets = std::iter::once(target).chain(shuffled[context..].iter().copied()).take(2).collect();
        Tuple { scene: 0, context: shuffled[..context].to_vec(), targets }
    }

    fn central(&self) -> usize {
        let training = self.scene.training_views();
        let total = |v: usize| training.iter().map(|w| self.separation(v, *w)).sum::<f64>();
        training.iter().map(|&v| (total(v), v)).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap().1
    }
}

#[test]
fn tuples_and_frame_are_those_of_the_slow_definition() {
    for (views, tuples) in [(9, 40), (50, 40), (301, 40), (2000, 4)] {
        let slow = Slow::of(helix(views));
        let layout = [Layout::of(&slow.scene)];
        let rng = Stream::new(views as u64, 0, "test.tuples");
        for index in 0..tuples {
            let found = training_tuple(&layout, rng, index, 6, 4, 2);
            assert_eq!(found, slow.tuple(rng, index, 6, 4), "{views} views, tuple {index}");
        }
        assert_eq!(layout[0].separation(1, 2).to_bits(), slow.separation(1, 2).to_bits());
        if views < 2000 {
            assert_eq!(layout[0].central_view(), slow.central(), "{views} views");
        }
    }
}

/// With five views the target stands in for the second.
#[test]
fn the_target_stands_in_for_the_second_of_five() {
    let scenes = [Layout::of(&line(7))];
    let tuple = training_tuple(&scenes, Stream::new(1, 0, "test.tuples"), 0, 6, 4, 2);
    assert_eq!(tuple.targets[0], tuple.targets[1]);
}

#[test]
#[should_panic(expected = "scene line: 3 training views")]
fn too_small_a_scene_is_refused() {
    training_tuple(&[Layout::of(&line(6))], Stream::new(1, 0, "test.tuples"), 0, 6, 4, 2);
}

#[test]
fn evaluation_shows_the_nearest_training_views() {
    let tuples = evaluation_tuples(&line(13), 3, 4);
    assert_eq!(tuples.len(), 4);
    assert_eq!((tuples[1].scene, &tuples[1].targets[..]), (3, &[4][..]));
    assert_eq!(tuples[1].context, [3, 5, 2, 6]);
    assert_eq!(tuples[0].context, [1, 2, 3, 5]);
}

#[test]
fn ordered_samplers_take_distinct_views_as_they_say() {
    let scene = line(41);
    let layouts = [Layout::of(&scene)];
    let training = scene.training_views();
    let place = |view: &usize| training.iter().position(|v| v == view).unwrap();
    let mut spans = BTreeSet::new();
    for index in 0..200 {
        let rng = Stream::new(4, 0, "test.samplers");
        let gap = Sampler::BoundedGap.tuple(&layouts, rng, index, 4, 3);
        let (first, last) = (place(&gap.context[0]), place(&gap.context[3]));
        let all: BTreeSet<usize> = gap.context.iter().chain(&gap.targets).copied().collect();
        assert_eq!((gap.context.len(), gap.targets.len(), all.len()), (4, 3, 7));
        assert!(all.iter().all(|view| (first..=last).contains(&place(view))), "{gap:?}");
        assert!(last - first >= 21, "{gap:?}");
        spans.insert((first, last));
        let even = Sampler::Uniform.tuple(&layouts, rng, index, 4, 3);
        let places: Vec<usize> = even.context.iter().map(place).collect();
        assert_eq!(places, uniform(training.len(), 4));
        assert!(even.targets.len() == 3 && even.targets.iter().all(|view| !even.context.contains(view)), "{even:?}");
        let nearest = Sampler::Nearest { pool: 6 }.tuple(&layouts, rng, index, 4, 2);
        assert_eq!(nearest, training_tuple(&layouts, rng, index, 6, 4, 2));
    }
    assert!(spans.len() > 20, "{spans:?}");
    // Three training views: two of context, and the third as often as requested.
    let few = [Layout::of(&line(4))];
    for sampler in [Sampler::BoundedGap, Sampler::Uniform] {
        let tuple = sampler.tuple(&few, Stream::new(0, 0, "test.samplers"), 0, 2, 2);
        assert_eq!(tuple.targets[0], tuple.targets[1], "{tuple:?}");
        assert!(!tuple.context.contains(&tuple.targets[0]));
    }
}

/// Promise of `a_gap_is_bounded`.
#[test]
fn uniform_is_even() {
    assert_eq!(uniform(100, 16)[..4], [0, 6, 13, 19]);
    assert_eq!(uniform(100, 16)[15], 99);
    assert_eq!(uniform(5, 1), [0]);
    assert_eq!(uniform(0, 3), [0_usize; 0]);
}

/// The distance between the ends takes both bounds, of few views and of so many that their square is the larger one.
#[test]
fn gaps_reach_both_bounds() {
    for (views, least, most) in [(4, 12, 40), (14, 32, 196)] {
        let draw = |seed| bounded_gap(400, views, Stream::new(seed, 0, "test.gap")).unwrap();
        let gaps: BTreeSet<usize> = (0..4000).map(draw).map(|chosen| chosen[views - 1] - chosen[0]).collect();
        assert_eq!((gaps.first(), gaps.last()), (Some(&least), Some(&most)));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]

    /// Promise (options): samplers draw views by their definitions.
    #[test]
    fn a_gap_is_bounded(frames in 1_usize..400, views in 1_usize..25, seed in any::<u64>()) {
        let chosen = bounded_gap(frames, views, Stream::new(seed, 0, "test.gap"));
        let Some(chosen) = chosen else {
            prop_assert!(views > frames);
            return Ok(());
        };
        prop_assert_eq!(chosen.len(), views);
        prop_assert_eq!(chosen.iter().collect::<BTreeSet<_>>().len(), views);
        prop_assert!(chosen.iter().all(|&i| i < frames));
        let (first, last) = (chosen[0], chosen[views - 1]);
        prop_assert!(chosen.iter().all(|&i| first <= i && i <= last));
        if views > 1 && frames > 256 {
            let gap = last - first;
            prop_assert!(gap >= (3 * views).min(32) && gap <= (10 * views).max(views * views).min(256));
        }
    }
}
