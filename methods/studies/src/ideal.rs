//! The worth of mixing complementary experts: four experts, each exact on its own kind of motion and a best
//! approximation on the others. Tables of the router's results on a held-out camera, beside all alternatives, at three
//! seeds; and of the results after Gaussians are dropped: `ideal [patches|corners]`.

mod family;
mod frames;
mod study;
mod world;

use crate::Outcome;
use crate::arguments::Arguments;
use crate::oracle::{blend, convex_oracle};
use crate::table::{Rows, Table, mean};
use study::{Held, Routed, View, by_pixels, by_volume, held, views};
use weaver_dynamic::{RouterConfig, Score, best, hard_oracle};
use weaver_kernels::random::Stream;
use world::{EXPERTS, HELD_OUT, Layout, PIXELS, World};

const SEEDS: u64 = 3;
const STEPS: u64 = 300;
const MORE: u64 = 150;
/// Rates tried for the router's alternatives.
const PIXEL_RATES: [f64; 2] = [0.01, 0.003];
const VOLUME_RATES: [f64; 2] = [0.2, 0.05];

/// Adds the held-out camera's figures of one way.
fn add(rows: &mut Rows, name: impl Into<String>, held: Held) {
    rows.add(name, &[held.seen, held.unseen, held.right.map_or(f64::NAN, |share| 100.0 * share)]);
}

/// The mean over the seeds, and each of them.
fn cell(seeds: &[f64]) -> String {
    let known: Vec<f64> = seeds.iter().copied().filter(|x| !x.is_nan()).collect();
    let each = known.iter().map(|x| format!("{x:.1}")).collect::<Vec<_>>().join(", ");
    if known.is_empty() { "-".into() } else { format!("**{:.1}** ({each})", mean(&known)) }
}

/// Rows without training.
fn bounds(rows: &mut Rows, views: &[View]) {
    let hard = |choice: &dyn Fn(usize, usize) -> usize, frame: usize| {
        let mut gate = vec![0.0; EXPERTS.len() * PIXELS];
        (0..PIXELS).for_each(|pixel| gate[choice(frame, pixel) * PIXELS + pixel] = 1.0);
        gate
    };
    let shown = |frame: usize, gate: Vec<f64>| (blend(&views[frame].images, &gate, PIXELS), gate);
    for (k, name) in EXPERTS.iter().enumerate() {
        add(rows, *name, held(views, |frame| shown(frame, hard(&|_, _| k, frame))));
    }
    let equal = vec![1.0 / EXPERTS.len() as f64; EXPERTS.len() * PIXELS];
    let uniform = held(views, |frame| shown(frame, equal.clone()));
    add(rows, "uniform mean", Held { right: None, ..uniform });
    let best: Vec<Vec<usize>> = views.iter().map(|view| hard_oracle(&view.images, &view.photo)).collect();
    add(rows, "hard oracle", held(views, |frame| shown(frame, hard(&|frame, pixel| best[frame][pixel], frame))));
    add(
        rows,
        "best convex blend",
        held(views, |frame| shown(frame, convex_oracle(&views[frame].images, &views[frame].photo))),
    );
}

fn config(temperature: f64) -> RouterConfig {
    RouterConfig { temperature, ..RouterConfig::default() }
}

/// Adds the router and its variants; returns the first one.
fn routers(rows: &mut Rows, world: &World, views: &[Vec<View>], seed: u64) -> Routed {
    let held_out = &views[HELD_OUT];
    let trained = |temperature: f64, w_alone: bool| {
        let mut routed = Routed::new(world, config(temperature), seed);
        routed.train(world, views, 0..STEPS, seed, w_alone);
        routed
    };
    let ours = trained(1.0, false);
    add(rows, "this router", held(held_out, ours.shown(world, 1.0)));
    let warm = trained(0.1, false);
    add(rows, "tau 0.1", held(held_out, warm.shown(world, 0.1)));
    let cold = trained(0.01, false);
    add(rows, "tau 0.01", held(held_out, cold.shown(world, 0.01)));
    add(rows, "tau 0.01, shown at 1", held(held_out, cold.shown(world, 1.0)));
    let alone = trained(1.0, true);
    add(rows, "w alone", held(held_out, alone.shown(world, 1.0)));
    ours
}

/// Quality when the lowest share of the Gaussians is dropped, at once and after more steps.
fn pruned(rows: &mut Rows, world: &World, views: &[Vec<View>], (routed, seed): (&Routed, u64)) {
    let count = routed.rows.len();
    let random = Stream::new(seed, 0, "dropped");
    let judged = [
        ("contribution", routed.scores(world, Score::Contribution)),
        ("sensitivity", routed.scores(world, Score::Sensitivity)),
        ("chance", (0..count as u64).map(|i| random.uniform(i)).collect()),
    ];
    for (share, (name, scores)) in [0.5, 0.25].into_iter().flat_map(|share| judged.iter().map(move |by| (share, by))) {
        let mut left = routed.pruned(world, &best(scores, share));
        let dropped = format!("{} % dropped by {name}", 100.0 * (1.0 - share));
        add(rows, &dropped, held(&views[HELD_OUT], left.shown(world, 1.0)));
        left.train(world, views, STEPS..STEPS + MORE, seed, false);
        add(rows, format!("{dropped}, {MORE} steps later"), held(&views[HELD_OUT], left.shown(world, 1.0)));
    }
}

/// Distances of the experts' Gaussians from the truth.
fn distances(world: &World, title: &str) {
    let table = Table::new(title, &EXPERTS);
    for (k, name) in EXPERTS.iter().enumerate() {
        let cells: Vec<String> = (0..EXPERTS.len()).map(|group| format!("{:.3}", world.distance(k, group))).collect();
        table.row(name, &cells);
    }
}

pub fn run(mut arguments: Arguments) -> Outcome {
    let named: Option<String> = arguments.optional("patches or corners")?;
    for layout in [Layout::Patches, Layout::Corners] {
        if named.as_ref().is_some_and(|name| !format!("{layout:?}").eq_ignore_ascii_case(name)) {
            continue;
        }
        let (mut quality, mut pruning) = (Rows::default(), Rows::default());
        for seed in 0..SEEDS {
            let world = World::new(seed, layout);
            if seed == 0 {
                distances(&world, &format!("{layout:?}. Root mean square of the distance from the truth, by groups"));
            }
            let views = views(&world);
            bounds(&mut quality, &views[HELD_OUT]);
            for rate in PIXEL_RATES {
                let row = by_pixels(&world, &views, [rate, STEPS as f64], seed);
                add(&mut quality, format!("pixel router, rate {rate}"), row);
            }
            for rate in VOLUME_RATES {
                let row = by_volume(&world, &views, [rate, STEPS as f64], seed);
                add(&mut quality, format!("volume router, rate {rate}"), row);
            }
            let ours = routers(&mut quality, &world, &views, seed);
            if layout == Layout::Patches {
                pruned(&mut pruning, &world, &views, (&ours, seed));
            }
        }
        let columns = ["seen frames, dB", "unseen frames, dB", "right, %"];
        quality.print(&format!("{layout:?}, a camera that was held out"), &columns, cell);
        if layout == Layout::Patches {
            pruning.print(&format!("{layout:?}, this router with fewer Gaussians"), &columns, cell);
        }
    }
    Ok(())
}
