//! Classifies the points of three spiral arms: `cargo run --release -p weaver-nn --example spiral`.
//!
//! A perceptron with two hidden layers learns from 600 noisy points. Writes spiral.png (its classes over the whole
//! plane, and the points) and prints how many of 3000 new points it gets right.

use weaver_autograd::ops::{Activation, cross_entropy};
use weaver_autograd::{Params, Tape, Var};
use weaver_io::Image;
use weaver_kernels::random::Stream;
use weaver_nn::{AdamW, Builder, Context, Group, Linear, WarmupCosine, WeightInit};

const ARMS: usize = 3;
const STEPS: u64 = 800;
const SIDE: usize = 240;
const COLORS: [[f32; 3]; ARMS] = [[0.85, 0.25, 0.25], [0.2, 0.6, 0.35], [0.25, 0.4, 0.85]];

/// Points `[N, 2]` within the unit circle, and the arm that each belongs to.
fn points(count: usize, seed: u64) -> (Vec<f32>, Vec<u32>) {
    let stream = Stream::new(seed, 0, "spiral");
    let point = |i: usize| {
        let (arm, r) = (i % ARMS, stream.uniform::<f32>(2 * i as u64));
        let turn = 4.5 * r + 0.12 * stream.normal::<f32>(2 * i as u64 + 1);
        let angle = turn + std::f32::consts::TAU * arm as f32 / ARMS as f32;
        ([r * angle.cos(), r * angle.sin()], arm as u32)
    };
    let (places, arms): (Vec<_>, Vec<_>) = (0..count).map(point).unzip();
    (places.concat(), arms)
}

fn logits<'t>(layers: &[Linear; 3], cx: Context<'t, '_>, x: Var<'t>) -> Var<'t> {
    let x = layers[0].forward_with(cx, x, Activation::Gelu);
    layers[2].forward(cx, layers[1].forward_with(cx, x, Activation::Gelu))
}

/// The likeliest arm of every point.
fn classify(layers: &[Linear; 3], params: &Params, places: &[f32]) -> Vec<usize> {
    let tape = Tape::new();
    let scores = logits(layers, Context::new(&tape, params), tape.constant(places, [places.len() / 2, 2])).to_vec();
    let best = |row: &[f32]| (0..ARMS).max_by(|&a, &b| row[a].total_cmp(&row[b])).expect("there are arms");
    scores.chunks(ARMS).map(best).collect()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut params = Params::<f32>::new();
    let mut root = Builder::new(&mut params, 0);
    let layers = [("first", 2, 48), ("second", 48, 48), ("last", 48, ARMS)]
        .map(|(name, from, to)| Linear::new(root.scope(name), from, to, WeightInit::FanIn));
    let group = Group { params: params.ids().collect(), lr_scale: 0.01, weight_decay: 0.01 };
    let mut optimizer = AdamW::new(vec![group], 0.9, 0.99, 1e-8);
    let schedule = WarmupCosine { warmup: 20, total: STEPS, floor: 0.01 };

    let (places, arms) = points(600, 1);
    let mut tape = Tape::new();
    for step in 0..STEPS {
        let x = tape.constant(&places, [arms.len(), 2]);
        let loss = cross_entropy(logits(&layers, Context::new(&tape, &params), x), &arms, 0.0);
        if step % 200 == 0 {
            println!("step {step:3}: cross entropy {:.3}", loss.item());
        }
        loss.backward();
        optimizer.step(&mut params, &mut tape, schedule.factor(step));
        tape.reset();
    }

    let (unseen, truth) = points(3000, 2);
    let right = classify(&layers, &params, &unseen).iter().zip(&truth).filter(|(a, b)| **a as u32 == **b).count();
    println!("{:.1} % of {} new points", 100.0 * right as f64 / truth.len() as f64, truth.len());

    let coordinate = |i: usize| 2.4 * (i as f32 + 0.5) / SIDE as f32 - 1.2;
    let plane: Vec<f32> = (0..SIDE * SIDE).flat_map(|i| [coordinate(i % SIDE), coordinate(i / SIDE)]).collect();
    let region = |arm: usize| COLORS[arm].map(|c| 0.5 + 0.5 * c);
    let mut pixels: Vec<f32> = classify(&layers, &params, &plane).into_iter().flat_map(region).collect();
    for (place, arm) in places.chunks(2).zip(&arms) {
        let [x, y] = [place[0], place[1]].map(|v| ((v + 1.2) / 2.4 * SIDE as f32) as usize);
        for at in [[x, y], [x + 1, y], [x, y + 1], [x + 1, y + 1]] {
            pixels[3 * (at[1] * SIDE + at[0])..][..3].copy_from_slice(&COLORS[*arm as usize]);
        }
    }
    Image { width: SIDE, height: SIDE, pixels }.write_png("spiral.png")?;
    Ok(())
}
