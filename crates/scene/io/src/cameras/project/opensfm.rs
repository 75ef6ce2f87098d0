//! Reconstructions of OpenSfM and OpenDroneMap.
//!
//! Poses are world to camera with OpenCV's axes, rotations as an axis times an angle. Lengths in photos are in longer
//! sides, from the middle of the photo. The world has the axes east, north and up at `reference_lla`.

use super::{Project, ProjectKind, Source, lens};
use crate::Result;
use crate::files::json::{self, found, kind, numbers};
use serde_json::{Map, Value};
use weaver_geometry::geodesy::{Geographic, Origin};
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Camera, Distortion, Intrinsics, Pose};
use weaver_scene::Frame;

pub(super) fn read(source: &Source) -> Result<Project> {
    let root = json::read(source.path)?;
    let all = root.as_array().map_or(&[][..], Vec::as_slice);
    let shots = |value: &Value| value["shots"].as_object().map_or(0, Map::len);
    let largest = (0..all.len()).max_by_key(|i| (shots(&all[*i]), std::cmp::Reverse(*i)));
    let Some(at) = largest else {
        return Ok(Project::new(ProjectKind::OpenSfm, Vec::new()));
    };
    let place = format!("[{at}]");
    let reader = Reader { source, place, value: &all[at] };
    let mut project = reader.project()?;
    let others: usize = all.iter().map(shots).sum::<usize>() - shots(&all[at]);
    if others > 0 {
        project.remarks.push(format!(
            "{}: {} reconstructions in worlds of their own; the largest is used, without {others} photos",
            source.path.display(),
            all.len()
        ));
    }
    Ok(project)
}

/// A reconstruction.
struct Reader<'a> {
    source: &'a Source<'a>,
    place: String,
    value: &'a Value,
}

impl Reader<'_> {
    fn project(&self) -> Result<Project> {
        let mut frames = Vec::new();
        for (name, shot) in self.object("shots")? {
            frames.push(self.frame(name, shot)?);
        }
        let mut project = Project::new(ProjectKind::OpenSfm, frames);
        for (id, point) in self.value["points"].as_object().into_iter().flatten() {
            let wrong = |key: &str, value: &Value| {
                self.source.invalid(format!("{}.points.{id}.{key}", self.place), "3 numbers", found(value))
            };
            let xyz: [f64; 3] =
                numbers(&point["coordinates"]).ok_or_else(|| wrong("coordinates", &point["coordinates"]))?;
            let rgb: [f64; 3] = numbers(&point["color"]).ok_or_else(|| wrong("color", &point["color"]))?;
            project.points.push(xyz);
            project.colors.push(rgb.map(|x| x.clamp(0.0, 255.0) as u8));
        }
        let place = &self.value["reference_lla"];
        if place.is_object() {
            let number = |key: &str| place[key].as_f64();
            if let (Some(latitude), Some(longitude), Some(altitude)) =
                (number("latitude"), number("longitude"), number("altitude"))
            {
                // Without GPS all of it is 0.
                let known = (latitude, longitude) != (0.0, 0.0);
                let place = Geographic { latitude, longitude, altitude };
                project.origin = known.then_some(Origin::Geographic(place));
            }
        }
        Ok(project)
    }

    fn object(&self, key: &str) -> Result<&Map<String, Value>> {
        let value = &self.value[key];
        value.as_object().ok_or_else(|| self.source.invalid(format!("{}.{key}", self.place), "an object", kind(value)))
    }

    fn frame(&self, name: &str, shot: &Value) -> Result<Frame> {
        let place = format!("{}.shots.{name}", self.place);
        let three = |key: &str| -> Result<DVec3> {
            let value = &shot[key];
            let numbers = numbers(value).map(DVec3::from);
            numbers.ok_or_else(|| self.source.invalid(format!("{place}.{key}"), "3 numbers", found(value)))
        };
        let (turn, translation) = (three("rotation")?, three("translation")?);
        let (axis, angle) = (turn.normalize_or_zero(), turn.length());
        let rotation = if angle > 0.0 { DMat3::from_axis_angle(axis, angle) } else { DMat3::IDENTITY };
        let Some(id) = shot["camera"].as_str() else {
            let value = found(&shot["camera"]);
            return Err(self.source.invalid(format!("{place}.camera"), "the name of a camera", value));
        };
        let (size, intrinsics, distortion) = self.camera(id)?;
        let (name, path, _) = self.source.photo(&place, name, Some(size))?;
        let camera = Camera { pose: Pose::new(rotation, translation), intrinsics, width: size.0, height: size.1 };
        Ok(Frame { path, distortion, ..Frame::new(name, camera) })
    }

    fn camera(&self, id: &str) -> Result<((usize, usize), Intrinsics, Option<Distortion>)> {
        let place = format!("{}.cameras.{id}", self.place);
        let Some(camera) = self.object("cameras")?.get(id) else {
            return Err(self.source.invalid(&place, "a camera that a photo names", "nothing"));
        };
        let invalid =
            |key: &str, expected: &str| self.source.invalid(format!("{place}.{key}"), expected, found(&camera[key]));
        let side = |key: &str| {
            let side = camera[key].as_f64().filter(|x| (1.0..=1_048_576.0).contains(x) && x.fract() == 0.0);
            side.map(|side| side as usize).ok_or_else(|| invalid(key, "a size in pixels"))
        };
        let size = (side("width")?, side("height")?);
        let longer = size.0.max(size.1) as f64;
        let number = |key: &str| match &camera[key] {
            Value::Null => Ok(0.0),
            value => value.as_f64().ok_or_else(|| invalid(key, "a number")),
        };
        let focal = |key: &str| -> Result<f64> {
            let key = if camera[key].is_null() { "focal" } else { key };
            let focal = camera[key].as_f64().filter(|f| *f > 0.0);
            Ok(longer * focal.ok_or_else(|| invalid(key, "a positive number"))?)
        };
        let (cx, cy) = (number("c_x")? * longer, number("c_y")? * longer);
        let (cx, cy) = (0.5 * size.0 as f64 + cx, 0.5 * size.1 as f64 + cy);
        let intrinsics = Intrinsics { fx: focal("focal_x")?, fy: focal("focal_y")?, cx, cy };
        let k = [number("k1")?, number("k2")?, number("k3")?, number("k4")?];
        let radial =
            |k: [f64; 3], p: [f64; 2]| lens::brown([k[0], k[1], k[2], 0.0], p, &intrinsics, size).unwrap_or(None);
        let distortion = match camera["projection_type"].as_str() {
            Some("perspective" | "radial") => radial([k[0], k[1], 0.0], [0.0; 2]),
            Some("simple_radial") => radial([k[0], 0.0, 0.0], [0.0; 2]),
            Some("brown") => radial([k[0], k[1], k[2]], [number("p1")?, number("p2")?]),
            Some("fisheye") => Some(Distortion::Fisheye { k: [k[0], k[1], 0.0, 0.0] }),
            Some("fisheye_opencv") => Some(Distortion::Fisheye { k }),
            _ => {
                let expected = "perspective, simple_radial, radial, brown, fisheye or fisheye_opencv; undistort photos of \
                                others (`opensfm undistort`)";
                return Err(invalid("projection_type", expected));
            }
        };
        Ok((size, intrinsics, distortion))
    }
}
