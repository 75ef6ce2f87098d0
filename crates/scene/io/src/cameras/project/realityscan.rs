//! Cameras of RealityScan and RealityCapture: the table Internal/External camera parameters.
//!
//! A camera looks down with the top of its photo to the north where heading, pitch and roll are 0; it is turned by roll
//! about its y axis, then by pitch about x, then by heading clockwise about the world's z. The focal length is for a
//! film of 36 mm along the longer side; the principal point is an offset from the middle of the photo, in longer sides.

use super::{Project, ProjectKind, Source, lens};
use crate::Result;
use crate::files::file::read_text;
use csv::{ReaderBuilder, StringRecord, Trim};
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose, axes};
use weaver_scene::Frame;

/// Width of the film that focal lengths are for, millimeters.
const FILM: f64 = 36.0;
/// Columns of every such table.
const POSE: [&str; 6] = ["x", "y", "alt", "heading", "pitch", "roll"];

/// The line of a text with the names of columns: a first line may have the number of cameras.
fn header(text: &str) -> Option<(usize, Vec<String>)> {
    text.lines().take(2).enumerate().find_map(|(at, line)| {
        let names: Vec<String> = line
            .split([',', ';'])
            .map(|name| name.trim().trim_matches('"').trim_start_matches('#').to_lowercase())
            .collect();
        let is_header = ["name"].iter().chain(&POSE).all(|key| names.iter().any(|name| name == key));
        is_header.then_some((at, names))
    })
}

/// True if a text begins as such a table does.
pub(super) fn is_header(text: &str) -> bool {
    header(text).is_some()
}

pub(super) fn read(source: &Source) -> Result<Project> {
    let text = read_text(source.path)?;
    let Some((at, names)) = header(text.trim_start()) else {
        return Err(source.invalid("line 1", "names of columns", "others"));
    };
    let table: String = text.trim_start().lines().skip(at + 1).map(|line| format!("{line}\n")).collect();
    let delimiter = if text.lines().nth(at).is_some_and(|line| line.contains(';')) { b';' } else { b',' };
    let mut rows =
        ReaderBuilder::new().has_headers(false).trim(Trim::All).delimiter(delimiter).from_reader(table.as_bytes());
    let table = Table { source, names: &names };
    if table.column("f").is_none() {
        let expected = "f, the focal length: export Internal/External camera parameters";
        return Err(source.invalid("columns", expected, names.join(",")));
    }
    let mut frames = Vec::new();
    for (row, line) in rows.records().zip(at + 2..) {
        let row =
            row.map_err(|error| source.invalid(format!("line {line}"), format!("{} columns", names.len()), error))?;
        frames.push(table.frame(&row, line)?);
    }
    Ok(Project::new(ProjectKind::RealityScan, frames))
}

struct Table<'a> {
    source: &'a Source<'a>,
    names: &'a [String],
}

impl Table<'_> {
    fn column(&self, key: &str) -> Option<usize> {
        self.names.iter().position(|name| name == key)
    }

    /// A number of a row; 0 where the table has no such column.
    fn number(&self, row: &StringRecord, line: usize, key: &str) -> Result<f64> {
        let Some(text) = self.column(key).map(|at| row.get(at).unwrap_or("")) else { return Ok(0.0) };
        let number = text.parse().ok().filter(|x: &f64| x.is_finite());
        number.ok_or_else(|| self.source.invalid(format!("line {line}, {key}"), "a finite number", format!("{text:?}")))
    }

    fn frame(&self, row: &StringRecord, line: usize) -> Result<Frame> {
        let place = format!("line {line}, name");
        let name = self.column("name").and_then(|at| row.get(at)).unwrap_or("");
        let (name, path, (width, height)) = self.source.photo(&place, name, None)?;
        let number = |key: &str| self.number(row, line, key);
        let angle = |key: &str| Ok(number(key)?.to_radians());
        let [heading, pitch, roll] = [angle("heading")?, angle("pitch")?, angle("roll")?];
        let rotation = DMat3::from_rotation_z(-heading) * DMat3::from_rotation_x(pitch) * DMat3::from_rotation_y(roll);
        let center = DVec3::new(number("x")?, number("y")?, number("alt")?);
        let longer = width.max(height) as f64;
        let f = number("f")? * longer / FILM;
        if f <= 0.0 {
            return Err(self.source.invalid(format!("line {line}, f"), "a positive focal length", number("f")?));
        }
        let (cx, cy) = (0.5 * width as f64 + number("px")? * longer, 0.5 * height as f64 + number("py")? * longer);
        let intrinsics = Intrinsics { fx: f, fy: f, cx, cy };
        let k = [number("k1")?, number("k2")?, number("k3")?, number("k4")?];
        let distortion =
            lens::brown(k, [number("t1")?, number("t2")?], &intrinsics, (width, height)).map_err(|off| {
                let expected = "a lens that OpenCV's model fits to a tenth of a pixel; align with Brown3, or export \
                            undistorted photos";
                self.source.invalid(format!("line {line}, k4"), expected, format!("{off:.2} pixels"))
            })?;
        let pose = axes::from_opengl(&Pose::new(rotation, center));
        Ok(Frame { path, distortion, ..Frame::new(name, Camera { pose, intrinsics, width, height }) })
    }
}
