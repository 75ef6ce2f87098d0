//! Bytes of a scene by each method, without training.
//!
//! `cargo run --release -p weaver-compression --example sizes -- scene.ply`

use weaver_compress::Pictures;
use weaver_compression::{METHODS, Task};
use weaver_scene::orbit;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("a file of Gaussians is missing")?;
    let gaussians = weaver_io::read_gaussians(path)?;
    let cameras = orbit(&gaussians, 6, [256, 256]).ok_or("a scene of which no orbit shows anything")?;
    let pictures = Pictures { cameras: &cameras, background: [1.0; 3], settings: Default::default() };
    let task = Task { gaussians: &gaussians, pictures, photos: &[], steps: 0, seed: 0 };
    for family in METHODS {
        for point in (family.points)() {
            println!("{:<14} {:<24} {:>10}", family.name, point.setting, point.method.encode(&task)?.len());
        }
    }
    Ok(())
}
