//! Looks at the scenes of endless training: `cargo run --release -p weaver-data --example varied_mosaic [PATH]`.
//!
//! Writes one picture (varied_mosaic.png by default) of sixteen varied scenes, first two views of each and a depth map,
//! and prints their properties.

use weaver_data::procedural::{ProceduralOptions, varied_scene};
use weaver_io::{Image, false_color};

const WIDTH: usize = 128;
const HEIGHT: usize = 96;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "varied_mosaic.png".into());
    let mut rows = Vec::new();
    for pair in 0..8 {
        let mut tiles = Vec::new();
        for seed in [2 * pair, 2 * pair + 1] {
            let scene = varied_scene(seed, &ProceduralOptions { width: WIDTH, height: HEIGHT, views: 8 });
            let [first, last] = [&scene.views[0], &scene.views[7]];
            let camera = &first.camera;
            let fov = 2.0 * (camera.width as f64 / 2.0 / camera.intrinsics.fx).atan().to_degrees();
            let turn = camera.pose.angle_to(&last.camera.pose).to_degrees();
            let depth = first.depth.as_deref().unwrap_or_default();
            let sky = depth.iter().filter(|z| **z == 0.0).count() * 100 / depth.len();
            println!("seed {seed}: view angle {fov:.0}, turn to the last view {turn:.0} degrees, {sky} % sky");
            tiles.extend([first.image.clone(), last.image.clone(), nearness(depth)]);
        }
        rows.push(Image::mosaic(&tiles.iter().collect::<Vec<_>>()));
    }
    let (width, height) = (rows[0].width, rows.iter().map(|row| row.height).sum());
    let pixels = rows.into_iter().flat_map(|row| row.pixels).collect();
    Image { width, height, pixels }.write_png(path)?;
    Ok(())
}

/// Near is bright; the sky has no depth and is black.
fn nearness(depth: &[f32]) -> Image {
    let (near, far) = depth.iter().filter(|z| **z > 0.0).fold((f32::MAX, 0_f32), |(a, b), z| (a.min(*z), b.max(*z)));
    let nearness: Vec<f32> = depth.iter().map(|z| if *z > 0.0 { -z.ln() } else { f32::NAN }).collect();
    false_color(&nearness, WIDTH, HEIGHT, -far.ln(), -near.ln())
}
