//! Cost of a training step of UR-DMU at its published size: features of 1024 numbers, width 512, 64 normal and 64
//! abnormal videos of 200 snippets, forward, backward and Adam.
//!
//! `cargo run --release -p weaver-vad --example published_step -- [STEPS]` prints the median of the seconds, the share
//! of the processors' peak in the matrix products, and the peak memory.

use std::time::Instant;
use weaver_kernels::peak;
use weaver_kernels::random::Stream;
use weaver_vad::{
    Detector, EncoderKind, Features, Labels, Result, Stage, StepReport, Trainer, TrainingSet, TrainingVideo, UrDmuSizes,
};

const HALF: usize = 64;
const SNIPPETS: usize = 200;
const FEATURES: usize = 1024;

fn main() -> Result<()> {
    let steps = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(5);
    let video = |i: usize| {
        let stream = Stream::new(1, i as u64, "published_step");
        let numbers = (0..SNIPPETS * FEATURES).map(|k| stream.uniform::<f32>(k as u64)).collect();
        TrainingVideo { abnormal: i < HALF, classes: Vec::new(), features: Features::in_memory(numbers, FEATURES) }
    };
    let set = TrainingSet { videos: (0..2 * HALF).map(video).collect(), classes: Vec::new() };
    let sizes = UrDmuSizes::published(FEATURES);
    let mut detector = Detector::new(EncoderKind::UrDmu(sizes), 0);
    let mut times = Vec::new();
    let mut last = Instant::now();
    let mut observe = |_: &StepReport| {
        times.push(last.elapsed().as_secs_f64());
        last = Instant::now();
    };
    let trainer = Trainer { set: &set, segments: SNIPPETS, batch: HALF, seed: 0 };
    // The first allocates.
    let stage = Stage { steps: steps + 1, rate: 1e-4, l2: 5e-5, decay: 0.0, dropout: 0.5 };
    trainer.encoder(&mut detector, &stage, Labels::None, &mut observe)?;
    times.remove(0);
    times.sort_by(f64::total_cmp);
    let median = times[times.len() / 2];
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let peak = peak::fma_gflops_f32(threads);
    // Forward, and twice as many backward; the features have no gradient.
    let rows = (2 * HALF * SNIPPETS) as f64;
    let products = 2.0 * rows * (3.0 * per_snippet(&sizes) - (3 * FEATURES * sizes.width) as f64);
    println!("{steps} steps of {HALF} + {HALF} videos of {SNIPPETS} snippets, {threads} threads: median {median:.2} s");
    println!(
        "{:.0} GFLOP of products: {:.0} GFLOP/s, {:.0} % of the measured peak of {peak:.0}",
        products / 1e9,
        products / median / 1e9,
        100.0 * products / median / 1e9 / peak
    );
    println!("most memory held: {}", memory());
    Ok(())
}

/// Products of numbers for each snippet, forward.
fn per_snippet(sizes: &UrDmuSizes) -> f64 {
    let UrDmuSizes { features, width, layers, heads, head, hidden, memory, score_hidden, .. } = *sizes;
    let inner = heads * head;
    let embedding = 3 * features * width;
    let attention = width * 4 * inner + 2 * SNIPPETS * inner + 2 * inner * width;
    let layer = attention + 2 * width * hidden;
    // Two memories, read and recalled; a mean of each, and a variance for half of the videos.
    let memories = 2 * (2 * memory * width + width * width) + width * width / 2;
    (embedding + layers * layer + memories + 2 * width * score_hidden) as f64
}

/// Peak memory of this process, if the system reports it.
fn memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.map_or("unknown".into(), |line| line.trim().into())
}
