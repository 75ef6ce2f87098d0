//! Looks at a built-in scene: `cargo run --release -p weaver-data --example contact_sheet [SEED]`.
//!
//! Writes contact_sheet.png (six photos from an arc, and under each its exact depth) and prints the content of the
//! scene.

use std::time::Instant;
use weaver_data::procedural::{ProceduralOptions, scene};
use weaver_io::{Image, false_color};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let seed = std::env::args().nth(1).map_or(Ok(5), |seed| seed.parse())?;
    let started = Instant::now();
    let scene = scene(seed, &ProceduralOptions { width: 160, height: 120, views: 24 });
    let seconds = started.elapsed().as_secs_f64();
    println!(
        "{}: {} views in {seconds:.2} s, {} held out",
        scene.name,
        scene.views.len(),
        scene.held_out_views().len()
    );
    println!("{} surface points, {} of them seen by view 0", scene.points.len(), scene.visible[0].len());

    let shown: Vec<_> = scene.views.iter().step_by(4).collect();
    let photos = Image::mosaic(&shown.iter().map(|view| &view.image).collect::<Vec<_>>());
    let colors = |depth: &[f32]| {
        let (near, far) =
            depth.iter().filter(|z| **z > 0.0).fold((f32::MAX, 0_f32), |(a, b), z| (a.min(*z), b.max(*z)));
        // Near is bright; the sky has no depth and is black.
        let nearness: Vec<f32> = depth.iter().map(|z| if *z > 0.0 { -z.ln() } else { f32::NAN }).collect();
        false_color(&nearness, 160, 120, -far.ln(), -near.ln())
    };
    let depths: Vec<Image> = shown.iter().filter_map(|view| view.depth.as_deref()).map(colors).collect();
    let depths = Image::mosaic(&depths.iter().collect::<Vec<_>>());
    let pixels = [photos.pixels, depths.pixels].concat();
    Image { width: photos.width, height: 2 * photos.height, pixels }.write_png("contact_sheet.png")?;
    Ok(())
}
