//! Spends a budget of Gaussians where a picture is intricate: `cargo run --release -p weaver-router --example
//! allocate`.
//!
//! The router's place is taken by the detail of the picture itself. Writes allocate.png (the picture; white where a
//! pixel gets a Gaussian: on a grid, at random, dithered by detail) and prints how much of the budget each spends on
//! the busiest quarter.

use weaver_autograd::Pool;
use weaver_data::procedural::{ProceduralOptions, scene};
use weaver_io::Image;
use weaver_kernels::random::Stream;
use weaver_router::{Allocation, AllocationRequest, Dithered, Grid, Random};
use weaver_wavelet::{EnergyMap, Wavelet};

const WIDTH: usize = 160;
const HEIGHT: usize = 120;
const BUDGET: f64 = 0.2;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let photo = &scene(12, &ProceduralOptions { width: WIDTH, height: HEIGHT, views: 4 }).views[0].image;
    let (pool, pixels) = (Pool::new(), WIDTH * HEIGHT);
    let channels: Vec<f32> = (0..3).flat_map(|c| photo.pixels.iter().skip(c).step_by(3).copied()).collect();
    let mut energy = vec![0.0_f32; pixels];
    EnergyMap::new(Wavelet::Db2, [HEIGHT, WIDTH]).compute(&channels, &pool, &mut energy);

    // Logits of "no Gaussian" and "one Gaussian": the density of Gaussians follows the logarithm of the detail.
    let logits: Vec<f32> = energy.iter().flat_map(|e| [0.0, (e + 0.01).ln()]).collect();
    let mut ranked = energy.clone();
    ranked.sort_unstable_by(f32::total_cmp);
    let busy = ranked[pixels * 3 / 4];
    let request = AllocationRequest {
        logits: &logits,
        energy: &energy,
        photos: &[],
        depth: None,
        views: 1,
        height: HEIGHT,
        width: WIDTH,
        stream: Stream::new(0, 0, "allocate"),
        inside: None,
        gumbel: None,
        pool: &pool,
    };
    let strategies: [(&str, &dyn Allocation); 3] = [
        ("grid", &Grid { budget: BUDGET }),
        ("random", &Random { budget: BUDGET }),
        ("dithered", &Dithered { budget: BUDGET, gamma: 1.0 }),
    ];
    let mut pictures = vec![photo.clone()];
    for (name, strategy) in strategies {
        let assignment = strategy.allocate(&request);
        let on_detail = assignment.expert.iter().zip(&energy).filter(|(e, energy)| **e > 0 && **energy > busy).count();
        let share = 100.0 * on_detail as f64 / assignment.count() as f64;
        println!("{name:8}: {} Gaussians, {share:.0} % on the busiest quarter of the pixels", assignment.count());
        let white = assignment.expert.iter().flat_map(|e| [f32::from(*e); 3]).collect();
        pictures.push(Image { width: WIDTH, height: HEIGHT, pixels: white });
    }
    Image::mosaic(&pictures.iter().collect::<Vec<_>>()).write_png("allocate.png")?;
    Ok(())
}
