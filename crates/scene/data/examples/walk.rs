//! Photographs a generated walk as a capture with exact cameras (transforms.json):
//! `cargo xtask walk --out DIR [--photos N] [--size PIXELS] [--seed N] [--facade]`.
//!
//! Photos are as wide as `--size` says (4000 are 12 megapixels) and three quarters as high, JPEG of quality 95.

use image::{ExtendedColorType, ImageEncoder, codecs::jpeg::JpegEncoder};
use rayon::prelude::*;
use std::error::Error;
use std::path::{Path, PathBuf};
use weaver_data::procedural::{ProceduralOptions, Walk};
use weaver_io::Transforms;
use weaver_scene::Frame;

const QUALITY: u8 = 95;

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
    (0..photos).into_par_iter().try_for_each(|i| write(&walk, i, &out)).map_err(|e| e.to_string())?;
    println!("{photos} photos of {} x {} pixels", options.width, options.height);
    Ok(())
}

fn name(number: usize) -> String {
    format!("images/{number:04}.jpg")
}

fn write(walk: &Walk, number: usize, out: &Path) -> Result<(), Box<dyn Error + Send + Sync>> {
    let image = walk.view(number).image;
    let mut bytes = Vec::new();
    let (width, height) = (image.width as u32, image.height as u32);
    JpegEncoder::new_with_quality(&mut bytes, QUALITY).write_image(
        &image.to_bytes(),
        width,
        height,
        ExtendedColorType::Rgb8,
    )?;
    Ok(std::fs::write(out.join(name(number)), bytes)?)
}
