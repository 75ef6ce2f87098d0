//! Photos to Gaussians, once: `cargo run --release -p weaver-model --example one_pass`.
//!
//! The `tiny` network, untrained, sees four photos of noise. Prints its size, its outputs, and the time of each part.

use std::time::Instant;
use weaver_autograd::{Params, Tape};
use weaver_kernels::random::Stream;
use weaver_model::{ModelConfig, SplatWeaver};
use weaver_nn::Context;
use weaver_router::Dithered;

fn main() {
    let config = ModelConfig::preset("tiny").expect("there is a preset called tiny");
    let (views, width, height) = (4, config.width, config.height);
    let mut params = Params::<f32>::new();
    let model = SplatWeaver::new(config, &mut params, 0);
    println!("{} parameters in {} tensors", params.count(), params.len());

    let tape = Tape::new();
    let cx = Context::new(&tape, &params);
    let noise = Stream::new(0, 0, "one_pass");
    let photos = tape.constant_with([1, views, 3, height, width], |pixels| {
        pixels.iter_mut().zip(0..).for_each(|(p, i)| *p = noise.uniform(i));
    });
    let timed = |what: &str, started: Instant| println!("{what:24}{:6.1} ms", 1e3 * started.elapsed().as_secs_f64());
    tape.without_gradient(|| {
        let started = Instant::now();
        let encoded = model.encode(cx, photos);
        timed("backbone and cameras", started);
        let (started, photos) = (Instant::now(), photos.reshape([views, 3, height, width]));
        let dense = model.dense(cx, &encoded, 0, photos);
        timed("depth and features", started);
        let started = Instant::now();
        let budget = Dithered { budget: 0.4, gamma: 1.0 };
        let predicted = model.gaussians(cx, &dense, photos, &encoded.scene_cameras(0), &budget, noise);
        timed("Gaussians", started);
        let (count, pixels) = (predicted.assignment.count(), views * height * width);
        println!(
            "{count} Gaussians for {pixels} pixels of {views} photos, means {}",
            predicted.gaussians.means.shape()
        );
    });
    println!("memory of the tape: {:.1} MB", tape.pool().allocated_bytes() as f64 / 1e6);
}
