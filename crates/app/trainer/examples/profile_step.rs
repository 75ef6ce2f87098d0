//! Where the time of a `tiny` training step goes: `cargo run --release -p weaver-trainer --example profile_step`.
//!
//! Runs some pose steps and some full steps on the built-in scenes with two threads, and prints the share of each kind
//! of work, steps per second, and the memory that the tape took.

use std::time::{Duration, Instant};
use weaver_trainer::splatweaver::SplatWeaverRecipe;
use weaver_trainer::{Config, Error, Session};

const WARM_UP: usize = 5;
const MEASURED: usize = 40;

/// A kind of work, and the ops that belong to it.
const KINDS: [(&str, &[&str]); 5] = [
    ("GEMM", &["linear", "matmul"]),
    ("convolution", &["conv2d", "conv_transpose2d"]),
    ("attention", &["attention"]),
    ("rasterizer", &["rasterize"]),
    ("nearest neighbors", &["nearest neighbors"]),
];

fn main() -> Result<(), Error> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads can be had");
    pool.install(|| {
        for stage in 0..2 {
            profile(stage)?;
        }
        Ok(())
    })
}

fn profile(stage: usize) -> Result<(), Error> {
    let mut config = Config::<SplatWeaverRecipe>::preset("tiny")?;
    config.stages = vec![config.stages[stage].clone()];
    let name = config.stages[0].name.clone();
    let mut session = Session::new(config)?;
    for _ in 0..WARM_UP {
        session.advance()?;
    }
    session.set_profiling(true);
    let started = Instant::now();
    for _ in 0..MEASURED {
        session.advance()?;
    }
    let total = started.elapsed();
    let times = session.op_times();
    let per_step = |d: Duration| d.as_secs_f64() * 1e3 / MEASURED as f64;
    println!("\nstage {name}: {:.1} ms a step, {:.2} steps/s", per_step(total), MEASURED as f64 / total.as_secs_f64());
    println!("| work | ms | share |\n|---|---|---|");
    let mut rest = total;
    for (kind, names) in KINDS {
        let time: Duration = times.iter().filter(|t| names.contains(&t.name)).map(|t| t.forward + t.backward).sum();
        rest = rest.saturating_sub(time);
        println!("| {kind} | {:.1} | {:.0} % |", per_step(time), 100.0 * time.as_secs_f64() / total.as_secs_f64());
    }
    println!("| the rest | {:.1} | {:.0} % |", per_step(rest), 100.0 * rest.as_secs_f64() / total.as_secs_f64());
    println!("tape memory: {:.1} MB", session.tape_bytes() as f64 / 1e6);
    let mut slowest = times;
    slowest.sort_by_key(|t| std::cmp::Reverse(t.forward + t.backward));
    println!("\n| op | calls | forward ms | backward ms |\n|---|---|---|---|");
    for t in slowest.iter().take(14) {
        let calls = t.calls / MEASURED as u64;
        println!("| {} | {calls} | {:.2} | {:.2} |", t.name, per_step(t.forward), per_step(t.backward));
    }
    Ok(())
}
