//! RealEstate10K camera files: a URL, then one camera per line.

use crate::files::file::read_text;
use crate::{Error, Result, atomic_write};
use std::path::Path;
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_scene::Frame;

/// The cameras of one clip.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clip {
    /// URL of the video.
    pub url: String,
    /// The cameras, in the order of the file.
    pub frames: Vec<ClipFrame>,
}

/// One camera of a clip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClipFrame {
    /// Microseconds from the start of the video; also the stem of the image's file name.
    pub timestamp: u64,
    /// `fx / width`, `fy / height`, `cx / width`, `cy / height`.
    pub normalized: [f64; 4],
    /// OpenCV world-to-camera.
    pub pose: Pose,
}

impl ClipFrame {
    /// Intrinsics in pixels for an image of `width` x `height`.
    pub fn intrinsics(&self, width: usize, height: usize) -> Intrinsics {
        let [fx, fy, cx, cy] = self.normalized;
        let (w, h) = (width as f64, height as f64);
        Intrinsics { fx: fx * w, fy: fy * h, cx: cx * w, cy: cy * h }
    }

    /// The frame of an image of `width` x `height`, named by its timestamp, which is also its time in microseconds.
    pub fn sized(&self, width: usize, height: usize) -> Frame {
        let camera = Camera { pose: self.pose, intrinsics: self.intrinsics(width, height), width, height };
        Frame { time: Some(self.timestamp as f64), ..Frame::new(self.timestamp.to_string(), camera) }
    }
}

impl Clip {
    /// Reads a camera file.
    ///
    /// The first line is the URL. Every other line is a timestamp, fx fy cx cy over the image size, two distortion
    /// coefficients, which must be zero, and the twelve numbers of `[R | t]`, world to camera, row by row.
    ///
    /// # Errors
    /// When the file cannot be read or a line is malformed.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let text = read_text(path)?;
        let mut lines = text.lines().zip(1..);
        let url = match lines.next() {
            Some((url, _)) if url.starts_with("http") => url.trim().to_string(),
            _ => return Err(Error::invalid(path, "line 1", "a URL", "something else")),
        };
        let frames: Vec<ClipFrame> = lines
            .filter(|(line, _)| !line.trim().is_empty())
            .map(|(line, number)| frame(path, line, number))
            .collect::<Result<_>>()?;
        if frames.is_empty() {
            return Err(Error::invalid(path, "lines", "a camera on each after the first", "none"));
        }
        Ok(Self { url, frames })
    }

    /// Writes a camera file.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        atomic_write(path, |w| {
            writeln!(w, "{}", self.url)?;
            for frame in &self.frames {
                write!(w, "{}", frame.timestamp)?;
                let rows = frame.pose.rows();
                for value in frame.normalized.iter().chain(&[0.0, 0.0]).chain(rows.as_flattened()) {
                    write!(w, " {value}")?;
                }
                writeln!(w)?;
            }
            Ok(())
        })
    }
}

fn frame(path: &Path, line: &str, number: usize) -> Result<ClipFrame> {
    let place = |what: &str| format!("line {number}, {what}");
    let fields: Vec<&str> = line.split_whitespace().collect();
    if fields.len() != 19 {
        return Err(Error::invalid(path, format!("line {number}"), "19 numbers", fields.len()));
    }
    let timestamp =
        fields[0].parse().map_err(|_| Error::invalid(path, place("timestamp"), "a whole number", fields[0]))?;
    let mut values = [0.0; 18];
    for (i, (to, field)) in values.iter_mut().zip(&fields[1..]).enumerate() {
        *to = (field.parse().ok())
            .filter(|x: &f64| x.is_finite())
            .ok_or_else(|| Error::invalid(path, place(&format!("column {}", i + 2)), "a finite number", field))?;
    }
    let [fx, fy, cx, cy, k1, k2, ref matrix @ ..] = values;
    if fx <= 0.0 || fy <= 0.0 {
        return Err(Error::invalid(path, place("focal length"), "positive numbers", format!("{fx} {fy}")));
    }
    if k1 != 0.0 || k2 != 0.0 {
        let expected = "0 0 (an undistorted camera)";
        return Err(Error::invalid(path, place("distortion"), expected, format!("{k1} {k2}")));
    }
    let mut rows = [[0.0; 4]; 3];
    rows.as_flattened_mut().copy_from_slice(matrix);
    let pose = Pose::from_rows(&rows)
        .map_err(|e| Error::invalid(path, place("matrix"), "a rigid world-to-camera transform", e))?;
    Ok(ClipFrame { timestamp, normalized: [fx, fy, cx, cy], pose })
}
