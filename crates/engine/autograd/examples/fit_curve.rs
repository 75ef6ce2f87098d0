//! Fits a logistic curve to noisy points: `cargo run --release -p weaver-autograd --example fit_curve`.
//!
//! One `pointwise!` line is the model, and the tape differentiates it in all three parameters. Prints the fitted
//! parameters beside the true ones.

use weaver_autograd::{Tape, apply_pointwise, pointwise};
use weaver_kernels::random::Stream;

pointwise!(
    /// height / (1 + exp(-rate (t - middle)))
    Logistic, 4, |t, height, rate, middle| height / (1 + (-(rate * (t - middle))).exp())
);

const TRUTH: [f64; 3] = [2.5, 3.0, 0.7];
const POINTS: usize = 200;
const STEPS: usize = 2000;

fn main() {
    let noise = Stream::new(0, 0, "fit_curve");
    let times: Vec<f64> = (0..POINTS).map(|i| 4.0 * i as f64 / POINTS as f64 - 1.0).collect();
    let [height, rate, middle] = TRUTH;
    let curve = |t: &f64| height / (1.0 + (-rate * (t - middle)).exp());
    let seen: Vec<f64> = times.iter().zip(0..).map(|(t, i)| curve(t) + 0.05 * noise.normal::<f64>(i)).collect();

    let mut found = [1.0, 1.0, 0.0];
    let mut tape = Tape::<f64>::new();
    for step in 0..=STEPS {
        let t = tape.constant(&times, [POINTS]);
        let [height, rate, middle] = found.map(|x| tape.leaf(&[x], [1]));
        let residual = apply_pointwise(Logistic, [t, height, rate, middle]) - tape.constant(&seen, [POINTS]);
        let loss = residual.square().mean();
        loss.backward();
        if step % 500 == 0 {
            println!("step {step:4}: error {:.4}, parameters {found:.3?}", loss.item().sqrt());
        }
        for (x, parameter) in found.iter_mut().zip([height, rate, middle]) {
            *x -= 0.3 * parameter.grad().expect("every parameter has a gradient")[0];
        }
        tape.reset();
    }
    println!("truth: noise of 0.0500, parameters {TRUTH:.3?}");
}
