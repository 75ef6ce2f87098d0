//! The compressed PLY files of SuperSplat: blocks of 256 Gaussians, each with the bounds of its values.
//!
//! An element `chunk` has the bounds of positions, logarithms of scales and colors of a block; `vertex` has four words
//! for each Gaussian: its position and scale in 11, 10 and 11 bits between these bounds, its rotation without the
//! largest component in 2 and three times 10, its color and opacity in four bytes; `sh`, if there are harmonics, a byte
//! for each of them from -4 to 4, one color after the other.

use super::header::first_lines;
use super::table::Elements;
use crate::gaussians::fields::{byte, check_values, unit};
use crate::gaussians::order::{Bounds, nearby, within};
use crate::gaussians::scene_file::Drawing;
use crate::{Error, Result};
use std::f32::consts::SQRT_2;
use std::io::{self, Write};
use std::path::Path;
use weaver_geometry::sh;
use weaver_scene::{Gaussians, forms};

/// Gaussians of a block.
const BLOCK: usize = 256;
/// Groups of properties with bounds, in the order of the header.
const BOUNDED: [[&str; 3]; 3] = [["x", "y", "z"], ["scale_x", "scale_y", "scale_z"], ["r", "g", "b"]];
const WORDS: [&str; 4] = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];
/// Values of a word of positions or scales, and of a component of a rotation.
const STEPS: [f32; 3] = [2047.0, 1023.0, 2047.0];
const TURNS: f32 = 1023.0;
/// The largest harmonic.
const LARGEST: f32 = 4.0;

pub(super) fn decode(path: &Path, data: &[u8]) -> Result<Gaussians> {
    let elements = Elements::read(path, data)?;
    let float = |name: &str| -> Result<Vec<f32>> {
        Ok(elements.column("chunk", name, "f32")?.into_iter().map(f32::from_le_bytes).collect())
    };
    let bounds = |names: &[&str; 3]| -> Result<Vec<Bounds>> {
        let [x, y, z] = names.map(|name| Ok([float(&format!("min_{name}"))?, float(&format!("max_{name}"))?]));
        let [x, y, z]: [[Vec<f32>; 2]; 3] = [x?, y?, z?];
        Ok((0..x[0].len()).map(|i| [&x, &y, &z].map(|axis| [axis[0][i], axis[1][i]])).collect())
    };
    let (positions, scales) = (bounds(&BOUNDED[0])?, bounds(&BOUNDED[1])?);
    // Files of earlier versions have colors from 0 to 1.
    let colors = if elements.names("chunk").iter().any(|name| name == "min_r") { bounds(&BOUNDED[2])? } else { vec![] };
    let words = |name: &str| -> Result<Vec<u32>> {
        Ok(elements.column("vertex", name, "u32")?.into_iter().map(u32::from_le_bytes).collect())
    };
    let [position, rotation, scale, color] = WORDS.map(words);
    let (position, rotation, scale, color) = (position?, rotation?, scale?, color?);
    let n = position.len();
    if positions.len() != n.div_ceil(BLOCK) {
        return Err(Error::invalid(
            path,
            "element chunk",
            format!("{} rows for {n} Gaussians", n.div_ceil(BLOCK)),
            positions.len(),
        ));
    }
    let rest = elements.names("sh").len();
    let Some(degree) = (0..=sh::MAX_DEGREE).find(|d| 3 * (sh::coefficients(*d) - 1) == rest) else {
        return Err(Error::invalid(path, "element sh", "0, 9, 24, 45 or 72 properties f_rest_*", rest));
    };
    let harmonics =
        (0..rest).map(|i| elements.column::<1>("sh", &format!("f_rest_{i}"), "u8")).collect::<Result<Vec<_>>>()?;
    if let Some(column) = harmonics.first().filter(|column| column.len() != n) {
        return Err(Error::invalid(path, "element sh", format!("{n} rows"), column.len()));
    }
    let mut gaussians = Gaussians { degree, ..Gaussians::default() };
    for i in 0..n {
        gaussians.means.push(unpacked(position[i], &positions[i / BLOCK]));
        gaussians.log_scales.push(unpacked(scale[i], &scales[i / BLOCK]));
        gaussians.quats.push(turn(rotation[i]));
        let [r, g, b, opacity] = color[i].to_be_bytes().map(|x| f32::from(x) / 255.0);
        gaussians.opacity_logits.push(forms::opacity_logit(opacity));
        let rgb = colors.get(i / BLOCK).map_or([r, g, b], |bounds| between(bounds, [r, g, b]));
        gaussians.sh.extend(rgb.map(forms::harmonic));
        for k in 0..rest / 3 {
            gaussians.sh.extend((0..3).map(|channel| harmonic(harmonics[channel * rest / 3 + k][i][0])));
        }
    }
    check_values(path, &gaussians)?;
    Ok(gaussians)
}

pub(crate) fn encode(path: &Path, gaussians: &Gaussians, drawing: Drawing, w: &mut dyn Write) -> Result<()> {
    check_values(path, gaussians)?;
    packed(gaussians, drawing, w).map_err(Error::io(path))
}

fn packed(gaussians: &Gaussians, drawing: Drawing, w: &mut dyn Write) -> io::Result<()> {
    let (n, k) = (gaussians.len(), gaussians.coefficients());
    // Gaussians of a block are to be near each other.
    let order = nearby(&gaussians.means);
    let blocks: Vec<Block> = order.chunks(BLOCK).map(|numbers| Block::new(gaussians, numbers)).collect();
    writeln!(w, "{}element chunk {}", first_lines(drawing), blocks.len())?;
    for names in BOUNDED {
        for side in ["min", "max"] {
            names.iter().try_for_each(|name| writeln!(w, "property float {side}_{name}"))?;
        }
    }
    writeln!(w, "element vertex {n}")?;
    WORDS.iter().try_for_each(|name| writeln!(w, "property uint {name}"))?;
    if k > 1 {
        writeln!(w, "element sh {n}")?;
        (0..3 * (k - 1)).try_for_each(|i| writeln!(w, "property uchar f_rest_{i}"))?;
    }
    writeln!(w, "end_header")?;
    for block in &blocks {
        for bounds in [&block.positions, &block.scales, &block.colors] {
            for side in 0..2 {
                bounds.iter().try_for_each(|axis| w.write_all(&axis[side].to_le_bytes()))?;
            }
        }
    }
    for (block, numbers) in blocks.iter().zip(order.chunks(BLOCK)) {
        for i in numbers.iter().copied() {
            let [r, g, b] = within(&block.colors, rgb(gaussians, i)).map(|x| byte(255.0 * x));
            let color = u32::from_be_bytes([r, g, b, byte(255.0 * forms::opacity(gaussians.opacity_logits[i]))]);
            let position = word(&block.positions, gaussians.means[i]);
            for word in [position, turned(gaussians.quats[i]), word(&block.scales, gaussians.log_scales[i]), color] {
                w.write_all(&word.to_le_bytes())?;
            }
        }
    }
    for i in order {
        let sh = &gaussians.sh[3 * k * i..][..3 * k];
        for channel in 0..3 {
            (1..k).try_for_each(|c| w.write_all(&[harmonic_byte(sh[3 * c + channel])]))?;
        }
    }
    Ok(())
}

/// The bounds of a block.
struct Block {
    positions: Bounds,
    scales: Bounds,
    colors: Bounds,
}

impl Block {
    fn new(gaussians: &Gaussians, numbers: &[usize]) -> Self {
        let bounds = |of: &dyn Fn(usize) -> [f32; 3]| -> Bounds {
            std::array::from_fn(|axis| {
                let values = || numbers.iter().map(|i| of(*i)[axis]);
                [values().fold(f32::INFINITY, f32::min), values().fold(f32::NEG_INFINITY, f32::max)]
            })
        };
        Self {
            positions: bounds(&|i| gaussians.means[i]),
            scales: bounds(&|i| gaussians.log_scales[i]),
            colors: bounds(&|i| rgb(gaussians, i)),
        }
    }
}

fn rgb(gaussians: &Gaussians, i: usize) -> [f32; 3] {
    std::array::from_fn(|c| forms::color(gaussians.sh[3 * gaussians.coefficients() * i + c]))
}

fn between(bounds: &Bounds, at: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| bounds[i][0] * (1.0 - at[i]) + bounds[i][1] * at[i])
}

fn word(bounds: &Bounds, at: [f32; 3]) -> u32 {
    let at = within(bounds, at);
    let [x, y, z] = std::array::from_fn(|i| (at[i] * STEPS[i]).round() as u32);
    x << 21 | y << 11 | z
}

fn unpacked(word: u32, bounds: &Bounds) -> [f32; 3] {
    let steps = [word >> 21, word >> 11 & 1023, word & 2047];
    between(bounds, std::array::from_fn(|i| steps[i] as f32 / STEPS[i]))
}

/// A rotation without its largest component, which counts as positive.
fn turned(q: [f32; 4]) -> u32 {
    let q = unit(q);
    let largest = (1..4).fold(0, |at, i| if q[i].abs() > q[at].abs() { i } else { at });
    let sign = q[largest].signum();
    (0..4).filter(|i| *i != largest).fold(largest as u32, |bits, i| {
        let step = (TURNS * (sign * q[i] / SQRT_2 + 0.5)).round().clamp(0.0, TURNS);
        bits << 10 | step as u32
    })
}

fn turn(word: u32) -> [f32; 4] {
    let largest = (word >> 30) as usize;
    let mut q = [0.0; 4];
    for (k, i) in (0..4).filter(|i| *i != largest).enumerate() {
        q[i] = ((word >> (20 - 10 * k) & 1023) as f32 / TURNS - 0.5) * SQRT_2;
    }
    q[largest] = (1.0 - q.iter().map(|x| x * x).sum::<f32>()).max(0.0).sqrt();
    q
}

/// The first and the last byte are the ends of the range, the others the middle of their step.
fn harmonic(byte: u8) -> f32 {
    let at = match byte {
        0 => 0.0,
        255 => 1.0,
        byte => (f32::from(byte) + 0.5) / 256.0,
    };
    (at - 0.5) * 2.0 * LARGEST
}

fn harmonic_byte(x: f32) -> u8 {
    (256.0 * (x / (2.0 * LARGEST) + 0.5)).floor().clamp(0.0, 255.0) as u8
}
