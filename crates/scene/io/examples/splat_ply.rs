//! Writes Gaussians that any 3DGS viewer opens: `cargo run --release -p weaver-io --example splat_ply`.
//!
//! A trefoil knot of 6000 Gaussians that shrink toward its outside, as PLY in stored form: log scales, logit opacities,
//! wxyz. Reads the file back and prints its content.

use std::f32::consts::TAU;
use weaver_geometry::sh;
use weaver_io::{read_gaussians, write_gaussians};
use weaver_scene::Gaussians;

const COUNT: usize = 6000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut splats = Gaussians { degree: 0, ..Gaussians::default() };
    for i in 0..COUNT {
        let t = TAU * i as f32 / COUNT as f32;
        let golden = (i as f32 * 0.618_034).fract();
        let around = TAU * golden;
        let r = 2.0 + (3.0 * t).cos();
        let tube = [0.25 * around.cos(), 0.25 * around.sin()];
        splats.means.push([
            (r + tube[0]) * (2.0 * t).cos(),
            (r + tube[0]) * (2.0 * t).sin(),
            (3.0 * t).sin() + tube[1],
        ]);
        splats.log_scales.push([(0.02 + 0.02 * golden).ln(); 3]);
        splats.quats.push([1.0, 0.0, 0.0, 0.0]);
        splats.opacity_logits.push(2.0);
        splats.sh.extend([0.0, 1.0, 2.0].map(|c| 0.4 * (t + TAU * c / 3.0).cos() / sh::DC as f32));
    }
    write_gaussians("knot.ply", &splats)?;
    let read = read_gaussians("knot.ply")?;
    println!("knot.ply: {} Gaussians, the same as written: {}", read.len(), read == splats);
    print!("{}", weaver_io::info("knot.ply")?);
    Ok(())
}
