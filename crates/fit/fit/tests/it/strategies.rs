//! The effect of strategies on a population.

use crate::scenes::{camera, cloud, finish, photos, plain, render};
use proptest::prelude::*;
use std::sync::Arc;
use weaver_fit::strategy::{Split, relocated};
use weaver_fit::{Density, Fit, FitSettings, Moment, Population, Strategy as Control, StrategyKind};
use weaver_kernels::random::Stream;
use weaver_scene::Gaussians;
use weaver_splat::{CpuRasterizer, GaussianStatistics};

const ALL: [StrategyKind; 3] = [StrategyKind::Split, StrategyKind::Mcmc, StrategyKind::Keep];

fn moment(step: usize, steps: usize, budget: usize) -> Moment {
    Moment {
        step,
        since: step,
        steps,
        budget,
        mean_rate: 1e-3,
        extent: 1.0,
        stream: Stream::new(5, step as u64, "test.density"),
    }
}

/// Statistics of a view that some of the Gaussians were not in.
fn statistics(count: usize, step: usize) -> Vec<GaussianStatistics<f32>> {
    let stream = Stream::new(9, step as u64, "test.statistics");
    let number = |n: usize, k: u64| stream.uniform::<f32>(8 * n as u64 + k);
    (0..count)
        .map(|n| match stream.below(8 * n as u64, 4) {
            0 => GaussianStatistics::default(),
            views => GaussianStatistics {
                screen_gradient: number(n, 1),
                absgrad: number(n, 2),
                views: views as u32,
                radius: 20.0 * number(n, 3),
                contribution: 50.0 * number(n, 4),
                largest_weight: number(n, 5),
            },
        })
        .collect()
}

proptest! {
    #[test]
    fn no_strategy_exceeds_the_budget(
        kind in prop::sample::select(ALL.to_vec()),
        (initial, budget) in (1usize..60).prop_flat_map(|n| (Just(n), n..120)),
        (rounds, steps) in (1usize..50, 1usize..60),
        (from, until) in (0.0..1.0, 0.0..1.0),
        (decay, growth) in (0.0f32..0.3, 0.0..2.0),
        seed in 0u64..100,
    ) {
        let density = Density { strategy: kind, rounds, from, until, opacity_decay: decay, growth, ..Density::default() };
        let mut strategy = density.strategy();
        let mut population = Population::new(&cloud(initial, seed));
        for step in 1..=steps {
            let statistics = statistics(population.len(), step);
            let before = population.len();
            let changed = strategy.adapt(&moment(step, steps, budget), &mut population, &statistics);
            prop_assert!(population.len() <= budget, "{} of {budget}", population.len());
            prop_assert!(changed || population.len() == before);
            for (name, field) in population.fields() {
                let length = population.len() * field.width();
                let lengths = [&field.values, &field.first, &field.second].map(Vec::len);
                prop_assert_eq!(lengths, [length; 3], "{}", name);
                prop_assert!(field.values.iter().all(|x| x.is_finite()), "{}", name);
            }
        }
    }
}

/// Of 10 Gaussians one is split, and nothing else happens.
fn split_one(gaussians: &Gaussians, chosen: usize) -> Population {
    let density = Density { opacity_decay: 0.0, least_opacity: 0.0, rounds: 10, from: 0.0, ..Density::default() };
    let mut population = Population::new(gaussians);
    let Population { means, log_scales, quats, logits, sh, .. } = &mut population;
    for field in [means, log_scales, quats, logits, sh] {
        field.first.fill(1.0);
        field.second.fill(1.0);
    }
    let mut statistics = vec![GaussianStatistics::default(); gaussians.len()];
    statistics[chosen] = GaussianStatistics { absgrad: 1.0, views: 1, largest_weight: 1.0, ..Default::default() };
    let budget = gaussians.len() + 1;
    let changed = Split::new(density).adapt(&moment(70, 100, budget), &mut population, &statistics);
    assert!(changed);
    assert_eq!(population.len(), budget);
    population
}

#[test]
fn halves_have_no_history() {
    let population = split_one(&cloud(10, 1), 4);
    for (name, field) in population.fields() {
        for n in 0..population.len() {
            let expected = if n == 4 || n == 10 { 0.0 } else { 1.0 };
            let rows = n * field.width()..(n + 1) * field.width();
            assert!(field.first[rows.clone()].iter().all(|x| *x == expected), "{name} of {n}");
            assert!(field.second[rows].iter().all(|x| *x == expected), "{name} of {n}");
        }
    }
}

#[test]
fn a_split_leaves_the_picture_nearly_as_it_was() {
    let view = [camera(0.0, 0.0)];
    for seed in 0..5 {
        let mut one = cloud(1, seed);
        one.means[0] = [0.1, -0.1, 4.0];
        one.log_scales[0] = [-0.7, -1.4, -1.2];
        let before = &render(&one, &view)[0];
        let after = &render(&split_one(&one, 0).to_gaussians(0), &view)[0];
        let without = &render(&Gaussians { opacity_logits: vec![-12.0], ..one.clone() }, &view)[0];
        let square = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
        let part = square(before, after) / square(before, without);
        assert!(part < 0.05, "seed {seed}: {part} of the Gaussian's energy");
    }
}

/// The integral over a line of the coverage of `copies` stacked Gaussians, by the trapezoidal rule.
fn integral(opacity: f64, scale: f64, copies: i32) -> f64 {
    let (reach, parts) = (12.0, 20_000);
    let at = |i: i32| -reach + 2.0 * reach * f64::from(i) / f64::from(parts);
    let covered = |x: f64| 1.0 - (1.0 - opacity * (-0.5 * (x / scale).powi(2)).exp()).powi(copies);
    (0..=parts).map(|i| covered(at(i))).sum::<f64>() * 2.0 * reach / f64::from(parts)
}

#[test]
fn relocated_copies_cover_what_one_covered() {
    for opacity in [0.01_f32, 0.2, 0.5, 0.9, 0.99] {
        for copies in [1, 2, 3, 7, 20, 51] {
            let (new, factor) = relocated(opacity, copies as usize);
            let peak = 1.0 - (1.0 - f64::from(new)).powi(copies);
            assert!((peak - f64::from(opacity)).abs() < 1e-5, "{opacity}, {copies}: peak {peak}");
            // The old one as equation 9 integrates it: alone, with a standard deviation of 1.
            let expected = integral(f64::from(opacity), 1.0, 1);
            let found = integral(f64::from(new), f64::from(factor), copies);
            assert!((found / expected - 1.0).abs() < 1e-4, "{opacity}, {copies}: {found}, not {expected}");
        }
    }
}

/// Doubles the first Gaussian every tenth step.
#[derive(Debug)]
struct EveryTenth;

impl Control for EveryTenth {
    fn wants_statistics(&self, _: &Moment) -> bool {
        true
    }

    fn adapt(&mut self, moment: &Moment, population: &mut Population, seen: &[GaussianStatistics<f32>]) -> bool {
        assert_eq!(seen.len(), population.len());
        assert!(moment.step % 10 == 1 || seen.iter().any(|s| s.views > 0), "statistics are sums since the last change");
        let due = moment.step.is_multiple_of(10) && population.len() < moment.budget;
        if due {
            population.duplicate(0);
        }
        due
    }
}

#[test]
fn a_strategy_of_ones_own() {
    let scene = cloud(20, 2);
    let settings: FitSettings = plain(StrategyKind::Keep, 45, 23);
    let mut fit =
        Fit::with(Arc::new(CpuRasterizer), Box::new(EveryTenth), photos(2, &scene), &scene, settings).expect("a fit");
    finish(&mut fit);
    assert_eq!(fit.population().len(), 23);
}
