//! Tuples and frame samplers.

use crate::scene::line;
use proptest::prelude::*;
use std::collections::BTreeSet;
use weaver_data::{bounded_gap, evaluation_tuples, every, training_tuple, uniform};
use weaver_kernels::random::Stream;

#[test]
fn a_training_tuple_is_a_shuffle_of_the_nearest() {
    let scenes = [line(12), line(30)];
    let rng = Stream::new(1, 0, "test.tuples");
    let (mut first, mut targets) = (BTreeSet::new(), BTreeSet::new());
    for index in 0..400 {
        let tuple = training_tuple(&scenes, rng, index, 6, 4, 2);
        assert_eq!(tuple, training_tuple(&scenes, rng, index, 6, 4, 2));
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

#[test]
fn with_five_views_the_target_stands_in_for_the_second() {
    let scenes = [line(7)];
    let tuple = training_tuple(&scenes, Stream::new(1, 0, "test.tuples"), 0, 6, 4, 2);
    assert_eq!(tuple.targets[0], tuple.targets[1]);
}

#[test]
#[should_panic(expected = "scene line: 3 training views")]
fn too_small_a_scene_is_refused() {
    training_tuple(&[line(6)], Stream::new(1, 0, "test.tuples"), 0, 6, 4, 2);
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
fn uniform_and_every() {
    assert_eq!(uniform(100, 16)[..4], [0, 6, 13, 19]);
    assert_eq!(uniform(100, 16)[15], 99);
    assert_eq!(uniform(5, 1), [0]);
    assert_eq!(uniform(0, 3), [0_usize; 0]);
    assert_eq!(every(20, 8, 7), [7, 15]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]

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
