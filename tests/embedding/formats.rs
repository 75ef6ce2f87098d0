//! Every format of scenes: `.splat` and `.spz` files are read, written as PLY and read again without a difference.

use flate2::{Compression, write::GzEncoder};
use std::io::Write;
use std::path::Path;
use weaver_io::{read_ply, read_splat, read_spz, write_ply};
use weaver_scene::Gaussians;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).ok_or("expected OUT")?;
    let folder = Path::new(&folder);

    // What a file holds is what the rasterizer takes, but for rounding.
    let scene = Gaussians {
        means: vec![[0.25, -0.5, 2.0], [1.0, 0.0, 3.0]],
        log_scales: vec![[-3.0, -2.0, -1.0], [-2.5; 3]],
        quats: vec![[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]],
        opacity_logits: vec![2.0, -1.0],
        sh: (0..24).map(|i| 0.1 * i as f32).collect(),
        degree: 1,
    };
    let back = scene.to_activated().to_stored();
    assert!(back.opacity_logits.iter().zip(&scene.opacity_logits).all(|(a, b)| (a - b).abs() < 1e-5));
    same_through_ply(&folder.join("scene.ply"), &scene)?;

    let path = folder.join("scene.splat");
    std::fs::write(&path, splat_record())?;
    let read = read_splat(&path)?;
    assert_eq!(read.means, [[0.25, -0.5, 2.0]]);
    same_through_ply(&folder.join("from-splat.ply"), &read)?;

    let path = folder.join("scene.spz");
    let mut packed = GzEncoder::new(Vec::new(), Compression::default());
    packed.write_all(&spz_record())?;
    std::fs::write(&path, packed.finish()?)?;
    let read = read_spz(&path)?;
    // The axes of SPZ are turned half about x.
    assert_eq!(read.means, [[0.25, 0.5, -2.0]]);
    same_through_ply(&folder.join("from-spz.ply"), &read)?;

    println!("ply, splat and spz: the same after a round trip");
    Ok(())
}

fn same_through_ply(path: &Path, scene: &Gaussians) -> Result<(), weaver_io::Error> {
    write_ply(path, scene)?;
    assert_eq!(&read_ply(path)?, scene, "{}", path.display());
    Ok(())
}

/// One Gaussian: position and scale as floats; color, opacity and rotation as bytes.
fn splat_record() -> Vec<u8> {
    let floats = [0.25f32, -0.5, 2.0, 0.1, 0.2, 0.3];
    let mut bytes: Vec<u8> = floats.iter().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([200, 128, 60, 230, 255, 128, 128, 128]);
    bytes
}

/// One Gaussian in version 2 without harmonics, with eight fractional bits for positions.
fn spz_record() -> Vec<u8> {
    let mut bytes = b"NGSP".to_vec();
    bytes.extend([2u32, 1].iter().flat_map(|x| x.to_le_bytes()));
    bytes.extend([0, 8, 0, 0]);
    for x in [0.25f64, -0.5, 2.0] {
        bytes.extend(&((x * 256.0) as i32).to_le_bytes()[..3]);
    }
    bytes.extend([230, 200, 128, 60, 120, 110, 100, 127, 127, 127]);
    bytes
}
