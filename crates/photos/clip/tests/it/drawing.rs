//! Clips that are drawn: a window that moves over an endless picture, so that each pixel's color is known.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use weaver_clip::{Error, PhotoFiles};
use weaver_io::{Bitmap, Observe, OutputFolder, PhotoFile};

/// True if an ffmpeg is installed; says so where there is none.
pub fn has_ffmpeg(test: &str) -> bool {
    let found = Command::new("ffmpeg").arg("-version").output().is_ok();
    if !found {
        println!("skipped: no ffmpeg ({test})");
    }
    found
}

/// A value in [0, 1) that looks random, of a cell of the picture.
fn noise(x: i64, y: i64, channel: u64) -> f64 {
    let mut h =
        (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (y as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f) ^ channel;
    for _ in 0..2 {
        h = (h ^ (h >> 31)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    }
    (h >> 11) as f64 / (1_u64 << 53) as f64
}

/// A smooth gray picture, from 0 to 1, with structure of `cell` pixels.
pub fn smooth(x: f64, y: f64, cell: f64) -> f64 {
    let (x, y) = (x / cell, y / cell);
    let (left, top) = (x.floor(), y.floor());
    let ease = |t: f64| t * t * (3.0 - 2.0 * t);
    let (u, v) = (ease(x - left), ease(y - top));
    let at = |dx: i64, dy: i64| noise(left as i64 + dx, top as i64 + dy, 7);
    (1.0 - v) * ((1.0 - u) * at(0, 0) + u * at(1, 0)) + v * ((1.0 - u) * at(0, 1) + u * at(1, 1))
}

/// Side of the patches of one color, pixels.
pub const PATCH: usize = 32;
/// Pixels that the window over the patches moves to the right with each picture.
pub const STEP: usize = 4;

/// The three values, from 0 to 1, of the patch that a pixel of a picture lies in.
pub fn patch([x, y]: [usize; 2], number: usize) -> [f64; 3] {
    [1, 2, 3].map(|channel| noise(((x + STEP * number) / PATCH) as i64, (y / PATCH) as i64, channel))
}

/// Pictures of patches, plane by plane, of the values that a patch becomes.
pub fn patches<T: Copy>(count: usize, (width, height): (usize, usize), value: impl Fn([f64; 3]) -> [T; 3]) -> Vec<T> {
    let pixels = move || (0..height).flat_map(move |y| (0..width).map(move |x| [x, y]));
    let mut raw = Vec::with_capacity(3 * count * width * height);
    for number in 0..count {
        (0..3).for_each(|channel| raw.extend(pixels().map(|at| value(patch(at, number))[channel])));
    }
    raw
}

/// Points in the middle of patches of a picture.
pub fn middles(number: usize, (width, height): (usize, usize)) -> Vec<[usize; 2]> {
    let half = PATCH / 2;
    let inside = |at: usize| (at + STEP * number) % PATCH == half;
    let columns = move || (half..width - half).filter(move |x| inside(*x));
    (half..height).step_by(PATCH).flat_map(|y| columns().map(move |x| [x, y])).collect()
}

/// Sets how a MOV is turned when it is shown: `[a, b, c, d]` takes (x, y) to (a x + c y, b x + d y).
pub fn set_matrix(clip: &Path, [a, b, c, d]: [f64; 4]) {
    let mut bytes = std::fs::read(clip).unwrap();
    let header = bytes.windows(4).rposition(|name| name == b"tkhd").unwrap();
    // Behind name, version, two times, number, duration, and eight bytes twice.
    for (i, value) in [a, b, 0.0, c, d, 0.0].into_iter().enumerate() {
        let at = header + 44 + 4 * i;
        bytes[at..at + 4].copy_from_slice(&((value * 65536.0).round() as i32).to_be_bytes());
    }
    std::fs::write(clip, bytes).unwrap();
}

/// The matrix of a turn by so many degrees clockwise.
pub fn turn(degrees: f64) -> [f64; 4] {
    let (sin, cos) = degrees.to_radians().sin_cos();
    [cos, sin, -sin, cos]
}

/// Where a pixel of a stored picture is shown after so many quarter turns clockwise.
pub fn turned([x, y]: [usize; 2], (width, height): (usize, usize), quarters: usize) -> [usize; 2] {
    match quarters {
        0 => [x, y],
        1 => [height - 1 - y, x],
        2 => [width - 1 - x, height - 1 - y],
        _ => [y, width - 1 - x],
    }
}

/// Encodes raw pictures with the installed ffmpeg, by arguments for its input and its output.
pub fn encode(raw: &[u8], (width, height): (usize, usize), input: &str, output: &str, to: &Path) {
    let mut command = Command::new("ffmpeg");
    command.args(["-loglevel", "error", "-y", "-f", "rawvideo", "-video_size", &format!("{width}x{height}")]);
    command.args(input.split_whitespace()).args(["-i", "pipe:0"]).args(output.split_whitespace()).arg(to);
    let mut child = command.stdin(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(raw).unwrap();
    assert!(child.wait().unwrap().success(), "ffmpeg {input} {output}");
}

/// Makes another clip of one.
pub fn convert(from: &Path, output: &str, to: &Path) {
    let mut command = Command::new("ffmpeg");
    command.args(["-loglevel", "error", "-y", "-i"]).arg(from).args(output.split_whitespace()).arg(to);
    assert!(command.status().unwrap().success(), "ffmpeg {output}");
}

/// Lines that a user reads.
#[derive(Default)]
pub struct Told {
    pub notes: Vec<String>,
    pub warnings: Vec<String>,
}

impl Observe for Told {
    fn note(&mut self, text: &str) {
        self.notes.push(text.into());
    }

    fn warning(&mut self, text: &str) {
        self.warnings.push(text.into());
    }
}

/// Frames of a clip.
pub struct Frames {
    /// Each with its number in the clip.
    pub photos: BTreeMap<usize, Bitmap>,
    /// When each was taken, seconds.
    pub times: BTreeMap<usize, f64>,
    pub told: Told,
}

/// The frames that become photos, at most so many.
pub fn frames(clip: &Path, most: usize) -> Result<Frames, Error> {
    let folder = tempfile::tempdir().unwrap();
    let paths = [clip.to_path_buf()];
    let out = OutputFolder::claim(folder.path().join("out"), "test", &paths)?;
    let mut told = Told::default();
    let files = PhotoFiles::collect(&paths, Some(most), &out, &mut told)?;
    let number = |path: &PathBuf| path.file_stem().unwrap().to_str().unwrap().parse().unwrap();
    let photo = |path: &PathBuf| (number(path), PhotoFile::at(path).unwrap().read().unwrap());
    let photos = files.paths.iter().map(photo).collect();
    let times = files.times.iter().map(|(path, time)| (number(path), *time)).collect();
    Ok(Frames { photos, times, told })
}

/// The mean color of the square of so many pixels each way around a pixel.
pub fn mean(photo: &Bitmap, [x, y]: [usize; 2], reach: usize) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for y in y - reach..=y + reach {
        for x in x - reach..=x + reach {
            (0..3).for_each(|c| sum[c] += f64::from(photo.pixels[3 * (y * photo.width + x) + c]));
        }
    }
    sum.map(|sum| sum / (2 * reach + 1).pow(2) as f64)
}
