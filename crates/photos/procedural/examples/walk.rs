//! Photographs a generated walk as a capture with exact cameras (transforms.json) and points (sparse_pc.ply):
//! `cargo xtask walk --out DIR [--photos N] [--size PIXELS] [--seed N] [--facade]`.
//!
//! Photos are as wide as `--size` says (4000 are 12 megapixels) and three quarters as high, JPEG of quality 95.

use image::{ExtendedColorType, ImageEncoder, codecs::jpeg::JpegEncoder};
use rayon::prelude::*;
use std::error::Error;
use std::path::{Path, PathBuf};
use weaver_data::View;
use weaver_geometry::glam::DVec2;
use weaver_io::Transforms;
use weaver_kernels::random::Stream;
use weaver_procedural::{ProceduralOptions, Walk};
use weaver_scene::{Frame, PointCloud};

const QUALITY: u8 = 95;
/// Points that a photo contributes.
const POINTS: usize = 60;

fn main() -> Result<(), Box<dyn Error>> {
    let (mut out, mut photos, mut size, mut seed, mut facade) = (None, 300, 1600, 1, false);
    let mut arguments = std::env::args().skip(1);
    while let Some(name) = arguments.next() {
        let mut value = || arguments.next().ok_or_else(|| format!("{name} needs a value"));
        match name.as_str() {
            "--out" => out = Some(PathBuf::from(value()?)),
            "--photos" => photos = value()?.parse()?,
            "--size" => size = value()?.parse()?,
            "--seed" => seed = value()?.parse()?,
            "--facade" => facade = true,
            _ => return Err(format!("{name} is none of --out, --photos, --size, --seed and --facade").into()),
        }
    }
    let out = out.ok_or("--out DIR is missing")?;
    std::fs::create_dir_all(out.join("images"))?;
    let options = ProceduralOptions { width: size, height: size * 3 / 4, views: photos };
    let walk = if facade { Walk::facade(seed, &options) } else { Walk::street(seed, &options) };
    let mut transforms = Transforms::default();
    for (i, camera) in walk.cameras().iter().enumerate() {
        transforms.frames.push(Frame::new(name(i), *camera));
    }
    transforms.write(out.join("transforms.json"))?;
    let points: Result<Vec<PointCloud>, _> = (0..photos).into_par_iter().map(|i| write(&walk, i, &out)).collect();
    let mut all = PointCloud::default();
    for PointCloud { positions, colors } in points.map_err(|e| e.to_string())? {
        all.positions.extend(positions);
        all.colors.extend(colors);
    }
    weaver_io::ply::write_points(out.join("sparse_pc.ply"), &all)?;
    println!("{photos} photos of {} x {} pixels", options.width, options.height);
    Ok(())
}

fn name(number: usize) -> String {
    format!("images/{number:04}.jpg")
}

/// Writes a photo, and returns some points that it shows.
fn write(walk: &Walk, number: usize, out: &Path) -> Result<PointCloud, Box<dyn Error + Send + Sync>> {
    let View { image, camera, depth, .. } = walk.view(number);
    let mut bytes = Vec::new();
    let (width, height) = (image.width as u32, image.height as u32);
    let pixels = image.to_bytes();
    JpegEncoder::new_with_quality(&mut bytes, QUALITY).write_image(&pixels, width, height, ExtendedColorType::Rgb8)?;
    std::fs::write(out.join(name(number)), bytes)?;
    let mut points = PointCloud::default();
    let stream = Stream::new(number as u64, 0, "points");
    for i in 0..POINTS {
        let at = (stream.bits(i as u64) % (image.width * image.height) as u64) as usize;
        let z = f64::from(depth.as_ref().map_or(0.0, |depth| depth[at]));
        if z > 0.0 {
            let pixel = DVec2::new((at % image.width) as f64 + 0.5, (at / image.width) as f64 + 0.5);
            points.positions.push(camera.unproject(pixel, z).as_vec3().to_array());
            points.colors.push([0, 1, 2].map(|c| pixels[3 * at + c]));
        }
    }
    Ok(points)
}
