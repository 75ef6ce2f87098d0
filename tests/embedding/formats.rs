//! Every format of scenes, written and read: `formats OUT`. PLY keeps every bit, `.splat` and `.spz` round to bytes.

use std::path::Path;
use weaver_io::{read_gaussians, write_gaussians};
use weaver_scene::Gaussians;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).ok_or("expected OUT")?;
    let folder = Path::new(&folder);
    let scene = Gaussians {
        means: vec![[0.25, -0.5, 2.0], [1.0, 0.0, 3.0]],
        log_scales: vec![[-3.0, -2.0, -1.0], [-2.5; 3]],
        quats: vec![[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]],
        opacity_logits: vec![2.0, -1.0],
        sh: vec![0.3, 0.2, 0.1, -0.1, 0.0, 0.1],
        degree: 0,
    };
    for (name, tolerance) in [("scene.ply", 0.0), ("scene.splat", 0.05), ("scene.spz", 0.05)] {
        let path = folder.join(name);
        write_gaussians(&path, &scene)?;
        let read = read_gaussians(&path)?;
        assert_eq!(read.len(), scene.len());
        let error = difference(&scene, &read);
        assert!(error <= tolerance, "{name}: {error}");
        // Rounded values are not rounded further.
        write_gaussians(&path, &read)?;
        let error_again = difference(&read, &read_gaussians(&path)?);
        assert!(error_again <= 1e-5, "{name}: {error_again}");
        println!("{name}: largest difference {error}");
    }
    Ok(())
}

/// The largest difference of two scenes as a rasterizer takes them.
fn difference(a: &Gaussians, b: &Gaussians) -> f32 {
    let (a, b) = (a.to_activated(), b.to_activated());
    let pairs = [(&a.means, &b.means), (&a.scales, &b.scales), (&a.opacities, &b.opacities), (&a.sh, &b.sh)];
    pairs.iter().flat_map(|(a, b)| a.iter().zip(b.iter())).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}
