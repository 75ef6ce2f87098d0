//! The text form: one record per line (two for images), `#` begins a comment line.

use super::camera::{MODELS, RawCamera};
use super::{CameraModel, ImageRecord, Model, POSE, Point, file, pose};
use crate::{Error, Result, atomic_write};
use std::collections::BTreeMap;
use std::path::Path;
use std::str::{FromStr, SplitWhitespace};

/// A line being read, field by field.
struct Fields<'a> {
    path: &'a Path,
    line: usize,
    fields: SplitWhitespace<'a>,
}

impl<'a> Fields<'a> {
    fn next<F: FromStr>(&mut self, what: &str) -> Result<F> {
        let field = self.fields.next().ok_or_else(|| self.invalid(what, "the end of the line"))?;
        field.parse().map_err(|_| self.invalid(what, field))
    }

    fn numbers<const N: usize>(&mut self, what: &str) -> Result<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.next(what)?;
        }
        Ok(values)
    }

    /// Records until the line ends, each read by `read`.
    fn until_end<R>(&mut self, mut read: impl FnMut(&mut Self) -> Result<R>) -> Result<Vec<R>> {
        let mut records = Vec::new();
        while self.fields.clone().next().is_some() {
            records.push(read(self)?);
        }
        Ok(records)
    }

    fn invalid(&self, expected: impl std::fmt::Display, found: impl std::fmt::Display) -> Error {
        Error::invalid(self.path, format!("line {}", self.line), expected, found)
    }
}

/// The lines that are no comments, empty ones included: an image without keypoints has an empty second line.
fn lines<'a>(path: &'a Path, text: &'a str) -> impl Iterator<Item = Fields<'a>> {
    let lines = text.lines().zip(1..).filter(|(line, _)| !line.trim_start().starts_with('#'));
    lines.map(move |(text, line)| Fields { path, line, fields: text.split_whitespace() })
}

fn is_blank(fields: &Fields) -> bool {
    fields.fields.clone().next().is_none()
}

pub(super) fn cameras(path: &Path, text: &str) -> Result<BTreeMap<u32, CameraModel>> {
    let mut cameras = BTreeMap::new();
    for mut fields in lines(path, text).filter(|f| !is_blank(f)) {
        let id = fields.next("a camera id")?;
        let name: String = fields.next("a camera model")?;
        let Some(&(_, model, count, one_focal)) = MODELS.iter().find(|m| m.1 == name) else {
            return Err(fields.invalid("a camera model of COLMAP", name));
        };
        let size = [fields.next("a width")?, fields.next("a height")?];
        let parameters = fields.until_end(|f| f.next("a camera parameter"))?;
        if parameters.len() != count {
            return Err(fields.invalid(format!("{count} parameters of {model}"), parameters.len()));
        }
        let camera = RawCamera { path, id, model, one_focal, size, parameters: &parameters }.check()?;
        if cameras.insert(id, camera).is_some() {
            return Err(fields.invalid("each camera once", format!("camera {id} again")));
        }
    }
    Ok(cameras)
}

pub(super) fn images(path: &Path, text: &str) -> Result<Vec<ImageRecord>> {
    let mut lines = lines(path, text);
    let mut images = Vec::new();
    while let Some(mut fields) = lines.next() {
        if is_blank(&fields) {
            continue;
        }
        let id = fields.next("an image id")?;
        let wxyz = fields.numbers("a quaternion")?;
        let translation = fields.numbers("a translation")?;
        let pose = pose(wxyz, translation).map_err(|found| fields.invalid(POSE, found))?;
        let camera_id = fields.next("a camera id")?;
        // Names may hold spaces.
        let name = fields.fields.clone().collect::<Vec<_>>().join(" ");
        if name.is_empty() {
            return Err(fields.invalid("an image name", "the end of the line"));
        }
        let points = match lines.next() {
            None => {
                return Err(fields.invalid("a line of keypoints after it", "the end of the file"));
            }
            Some(mut keypoints) => keypoints.until_end(|f| {
                let [x, y] = f.numbers("a keypoint")?;
                // -1, the id of no point, is no u64.
                let point: i64 = f.next("a point id")?;
                Ok((x, y, u64::try_from(point).ok()))
            })?,
        };
        images.push(ImageRecord { id, name, camera_id, pose, points });
    }
    Ok(images)
}

pub(super) fn points(path: &Path, text: &str) -> Result<Vec<Point>> {
    let point = |mut fields: Fields| {
        let id = fields.next("a point id")?;
        let xyz = fields.numbers("a position")?;
        if xyz.iter().any(|x: &f64| !x.is_finite()) {
            return Err(fields.invalid("a finite position", format!("{xyz:?}")));
        }
        let rgb = [fields.next("red")?, fields.next("green")?, fields.next("blue")?];
        let error = fields.next("a reprojection error")?;
        let track = fields.until_end(|f| Ok((f.next("an image id")?, f.next("a keypoint index")?)))?;
        Ok(Point { id, xyz, rgb, error, track })
    };
    lines(path, text).filter(|f| !is_blank(f)).map(point).collect()
}

pub(super) fn write(model: &Model, folder: &Path) -> Result<()> {
    atomic_write(file(folder, "cameras", "txt"), |w| {
        writeln!(w, "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]")?;
        for (id, camera) in &model.cameras {
            let (_, name, parameters) = camera.written();
            write!(w, "{id} {name} {} {}", camera.width, camera.height)?;
            parameters.iter().try_for_each(|x| write!(w, " {x}"))?;
            writeln!(w)?;
        }
        Ok(())
    })?;
    atomic_write(file(folder, "images", "txt"), |w| {
        writeln!(w, "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME")?;
        writeln!(w, "# POINTS2D[] as (X, Y, POINT3D_ID)")?;
        for image in &model.images {
            write!(w, "{}", image.id)?;
            for x in image.pose.wxyz().iter().chain(&image.pose.translation.to_array()) {
                write!(w, " {x}")?;
            }
            writeln!(w, " {} {}", image.camera_id, image.name)?;
            let mut gap = "";
            for (x, y, point) in &image.points {
                write!(w, "{gap}{x} {y} ")?;
                match point {
                    Some(id) => write!(w, "{id}")?,
                    None => write!(w, "-1")?,
                }
                gap = " ";
            }
            writeln!(w)?;
        }
        Ok(())
    })?;
    atomic_write(file(folder, "points3D", "txt"), |w| {
        writeln!(w, "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)")?;
        for point in &model.points {
            let ([x, y, z], [r, g, b]) = (point.xyz, point.rgb);
            write!(w, "{} {x} {y} {z} {r} {g} {b} {}", point.id, point.error)?;
            for (image, keypoint) in &point.track {
                write!(w, " {image} {keypoint}")?;
            }
            writeln!(w)?;
        }
        Ok(())
    })
}
