//! Pictures of Gaussians.

use super::META;
use super::codebook::Codebook;
use super::decode::{CENTROIDS, LARGEST};
use super::meta::{self, ANTIALIASED, Coded, Means, Meta, Quats, VERSION};
use super::palette::Palette;
use super::plane::Plane;
use crate::gaussians::fields::{byte, check_values, unit};
use crate::gaussians::order::{Bounds, bounds, nearby};
use crate::gaussians::scene_file::Drawing;
use crate::{Error, Result};
use std::f32::consts::SQRT_2;
use std::io;
use std::path::Path;
use weaver_scene::{Gaussians, forms};

/// Most rows of the palette.
const ROWS: usize = 1 << 16;

/// A file of a scene.
pub(in crate::gaussians) struct File {
    /// Its name beside the first, with slashes.
    pub name: String,
    pub content: Vec<u8>,
}

/// The files of a scene, `meta.json` last, so that it is there only when the others are.
pub(super) fn encoded(path: &Path, gaussians: &Gaussians, drawing: Drawing) -> Result<Vec<File>> {
    check_values(path, gaussians)?;
    // Neighbors among pixels are then neighbors in space.
    files(&gaussians.select(&nearby(&gaussians.means)), drawing).map_err(Error::io(path))
}

/// The files of Gaussians in their order.
pub(super) fn files(gaussians: &Gaussians, drawing: Drawing) -> io::Result<Vec<File>> {
    let n = gaussians.len();
    let k = 3 * gaussians.coefficients();
    let mut files = Vec::new();
    let mut add = |name: &str, plane: Plane| -> io::Result<String> {
        files.push(File { name: name.into(), content: plane.encoded()? });
        Ok(name.into())
    };
    let plane = |pixel: &dyn Fn(usize) -> [u8; 4]| {
        let mut plane = Plane::for_pixels(n);
        plane.pixels[..n].iter_mut().enumerate().for_each(|(i, p)| *p = pixel(i));
        plane
    };
    let logarithms: Vec<[f32; 3]> = gaussians.means.iter().map(|m| m.map(logarithm)).collect();
    let limits = if n > 0 { bounds(&logarithms) } else { [[0.0; 2]; 3] };
    let bytes = |i: usize, part: usize| {
        let [x, y, z] = steps(&limits, logarithms[i]).map(|steps| steps.to_le_bytes()[part]);
        [x, y, z, 255]
    };
    let means = Means {
        mins: limits.map(|[min, _]| min),
        maxs: limits.map(|[_, max]| max),
        files: [add("means_l.webp", plane(&|i| bytes(i, 0)))?, add("means_u.webp", plane(&|i| bytes(i, 1)))?],
    };
    let quats = Quats { files: [add("quats.webp", plane(&|i| turned(gaussians.quats[i])))?] };
    let codebook = Codebook::of(gaussians.log_scales.as_flattened().to_vec());
    let index = |i: usize| gaussians.log_scales[i].map(|s| codebook.index(s));
    let file = add("scales.webp", plane(&|i| with(index(i), 255)))?;
    let scales = Coded { codebook: codebook.numbers, files: [file] };
    let color = |i: usize| -> [f32; 3] { std::array::from_fn(|c| gaussians.sh[i * k + c]) };
    let codebook = Codebook::of((0..n).flat_map(color).collect());
    let opacity = |i: usize| byte(255.0 * forms::opacity(gaussians.opacity_logits[i]));
    let file = add("sh0.webp", plane(&|i| with(color(i).map(|c| codebook.index(c)), opacity(i))))?;
    let sh0 = Coded { codebook: codebook.numbers, files: [file] };
    let rest = (k > 3 && n > 0).then(|| {
        let rows: Vec<f32> = gaussians.sh.chunks_exact(k).flat_map(|row| &row[3..]).copied().collect();
        let palette = Palette::of(&rows, k - 3, rows_of(n));
        let codebook = Codebook::of(palette.centers.clone());
        let label = |i: usize| palette.labels[i].to_le_bytes();
        let labels = plane(&|i| [label(i)[0], label(i)[1], 0, 255]);
        let count = palette.centers.len() / (k - 3);
        let files = [
            add("shN_centroids.webp", centroids(&palette.centers, k / 3 - 1, &codebook))?,
            add("shN_labels.webp", labels)?,
        ];
        Ok::<_, io::Error>(meta::Palette { count, bands: gaussians.degree, codebook: codebook.numbers, files })
    });
    let model = drawing.antialiased.then(|| ANTIALIASED.to_string());
    let meta = Meta { version: VERSION, count: n, model, means, scales, quats, sh0, rest: rest.transpose()? };
    files.push(File { name: META.into(), content: serde_json::to_vec(&meta)? });
    Ok(files)
}

/// Rows of the palette of so many Gaussians: the largest power of two up to their number.
fn rows_of(n: usize) -> usize {
    (1 << n.ilog2()).min(ROWS)
}

/// A palette as a picture: rows of 64 centers, a pixel for each of their coefficients.
fn centroids(centers: &[f32], coefficients: usize, codebook: &Codebook) -> Plane {
    let count = centers.len() / (3 * coefficients);
    let mut plane = Plane::new(CENTROIDS * coefficients, count.div_ceil(CENTROIDS));
    for (pixel, rgb) in plane.pixels.iter_mut().zip(centers.as_chunks::<3>().0) {
        *pixel = with(rgb.map(|x| codebook.index(x)), 255);
    }
    plane
}

fn with([r, g, b]: [u8; 3], last: u8) -> [u8; 4] {
    [r, g, b, last]
}

/// `sign(x) ln(1 + |x|)`.
fn logarithm(x: f32) -> f32 {
    x.signum() * x.abs().ln_1p()
}

/// 16 bits between bounds.
fn steps(bounds: &Bounds, at: [f32; 3]) -> [u16; 3] {
    std::array::from_fn(|i| {
        let ([min, max], at) = (bounds[i].map(f64::from), f64::from(at[i]));
        if max > min { (65535.0 * (at - min) / (max - min)).round() as u16 } else { 0 }
    })
}

/// A rotation without its largest component, which counts as positive.
fn turned(q: [f32; 4]) -> [u8; 4] {
    let q = unit(q);
    let largest = (1..4).fold(0, |at, i| if q[i].abs() > q[at].abs() { i } else { at });
    let mut others = (0..4).filter(|i| *i != largest).map(|i| q[i] * q[largest].signum() * SQRT_2);
    let mut pixel = [0, 0, 0, LARGEST + largest as u8];
    pixel[..3].iter_mut().zip(&mut others).for_each(|(pixel, x)| *pixel = byte(127.5 * (x + 1.0)));
    pixel
}
