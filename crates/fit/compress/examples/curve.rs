//! Bits by decibels of a scene: `curve FILE [DECIBELS ...]`, on six pictures of an orbit, 256 pixels square, over
//! white.

use std::error::Error;
use weaver_compress::{Judge, Pictures, compress};
use weaver_scene::orbit;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("expected a file of Gaussians, found no argument")?;
    let asked: Vec<f64> = arguments.map(|text| text.parse()).collect::<Result<_, _>>()?;
    let asked = if asked.is_empty() { vec![36.0, 40.0, 43.0, 46.0, 50.0, 54.0] } else { asked };
    let gaussians = weaver_io::read_gaussians(&path)?;
    let cameras = orbit(&gaussians, 6, [256; 2]).ok_or("expected Gaussians, found none")?;
    let pictures = Pictures { cameras: &cameras, background: [1.0; 3], settings: Default::default() };
    let mut judge = Judge::new(&gaussians, &pictures)?;
    println!("wanted dB     dB    bytes  bits a Gaussian  steps");
    for wanted in asked {
        let compressed = compress(&gaussians, wanted, &mut judge, |_| {})?;
        let (bytes, q) = (compressed.bytes.len(), compressed.quality);
        println!(
            "{wanted:>9.1} {:>6.2} {bytes:>8} {:>16.2}  position {:.3}, scale {:.3}, opacity 1/{}, rotation {:.4}, color {:.3}, harmonics {:.3}",
            compressed.psnr,
            8.0 * bytes as f64 / gaussians.len() as f64,
            q.position,
            q.scale_step,
            q.opacity_levels,
            q.rotation_step,
            q.dc_step,
            q.sh_step
        );
    }
    Ok(())
}
