//! The binary form, little-endian.

use super::camera::{MODELS, RawCamera};
use super::{CameraModel, ImageRecord, Model, POSE, Point, file, pose};
use crate::files::bytes::Bytes;
use crate::{Result, atomic_write};
use std::collections::BTreeMap;
use std::path::Path;

/// In place of the id of a point: the keypoint observes none.
const NO_POINT: u64 = u64::MAX;

pub(super) fn cameras(path: &Path, data: &[u8]) -> Result<BTreeMap<u32, CameraModel>> {
    let mut bytes = Bytes::new(path, data);
    let mut cameras = BTreeMap::new();
    for _ in 0..bytes.count(24, "cameras")? {
        let id = bytes.u32("a camera id")?;
        let number = bytes.u32("a camera model")?;
        let Some(&(_, model, count, one_focal)) = MODELS.iter().find(|m| m.0 == number) else {
            return Err(bytes.invalid("a camera model from 0 to 10", number));
        };
        let size = [bytes.u64("a width")?, bytes.u64("a height")?];
        let parameters: Vec<f64> = (0..count).map(|_| bytes.f64("camera parameters")).collect::<Result<_>>()?;
        let camera = RawCamera { path, id, model, one_focal, size, parameters: &parameters }.check()?;
        if cameras.insert(id, camera).is_some() {
            return Err(bytes.invalid("each camera once", format!("camera {id} again")));
        }
    }
    bytes.finish()?;
    Ok(cameras)
}

pub(super) fn images(path: &Path, data: &[u8]) -> Result<Vec<ImageRecord>> {
    let mut bytes = Bytes::new(path, data);
    let mut images = Vec::new();
    for _ in 0..bytes.count(73, "images")? {
        let id = bytes.u32("an image id")?;
        let wxyz = bytes.f64s("a quaternion")?;
        let translation = bytes.f64s("a translation")?;
        let pose = pose(wxyz, translation).map_err(|found| bytes.invalid(POSE, found))?;
        let camera_id = bytes.u32("a camera id")?;
        let name = bytes.text("an image name")?;
        let count = bytes.count(24, "keypoints")?;
        let mut points = Vec::with_capacity(count);
        for _ in 0..count {
            let [x, y] = bytes.f64s("a keypoint")?;
            let point = bytes.u64("a point id")?;
            points.push((x, y, (point != NO_POINT).then_some(point)));
        }
        images.push(ImageRecord { id, name, camera_id, pose, points });
    }
    bytes.finish()?;
    Ok(images)
}

pub(super) fn points(path: &Path, data: &[u8]) -> Result<Vec<Point>> {
    let mut bytes = Bytes::new(path, data);
    let mut points = Vec::new();
    for _ in 0..bytes.count(51, "points")? {
        let id = bytes.u64("a point id")?;
        let xyz = bytes.f64s("a position")?;
        if xyz.iter().any(|x: &f64| !x.is_finite()) {
            return Err(bytes.invalid("a finite position", format!("{xyz:?} for point {id}")));
        }
        let rgb = bytes.take("a color")?;
        let error = bytes.f64("a reprojection error")?;
        let length = bytes.count(8, "observations")?;
        let mut track = Vec::with_capacity(length);
        for _ in 0..length {
            track.push((bytes.u32("an image id")?, bytes.u32("a keypoint index")?));
        }
        points.push(Point { id, xyz, rgb, error, track });
    }
    bytes.finish()?;
    Ok(points)
}

pub(super) fn write(model: &Model, folder: &Path) -> Result<()> {
    atomic_write(file(folder, "cameras", "bin"), |w| {
        w.write_all(&(model.cameras.len() as u64).to_le_bytes())?;
        for (id, camera) in &model.cameras {
            w.write_all(&id.to_le_bytes())?;
            let (number, _, parameters) = camera.written();
            w.write_all(&number.to_le_bytes())?;
            w.write_all(&(camera.width as u64).to_le_bytes())?;
            w.write_all(&(camera.height as u64).to_le_bytes())?;
            for x in parameters {
                w.write_all(&x.to_le_bytes())?;
            }
        }
        Ok(())
    })?;
    atomic_write(file(folder, "images", "bin"), |w| {
        w.write_all(&(model.images.len() as u64).to_le_bytes())?;
        for image in &model.images {
            w.write_all(&image.id.to_le_bytes())?;
            for x in image.pose.wxyz().iter().chain(&image.pose.translation.to_array()) {
                w.write_all(&x.to_le_bytes())?;
            }
            w.write_all(&image.camera_id.to_le_bytes())?;
            w.write_all(image.name.as_bytes())?;
            w.write_all(&[0])?;
            w.write_all(&(image.points.len() as u64).to_le_bytes())?;
            for (x, y, point) in &image.points {
                w.write_all(&x.to_le_bytes())?;
                w.write_all(&y.to_le_bytes())?;
                w.write_all(&point.unwrap_or(NO_POINT).to_le_bytes())?;
            }
        }
        Ok(())
    })?;
    atomic_write(file(folder, "points3D", "bin"), |w| {
        w.write_all(&(model.points.len() as u64).to_le_bytes())?;
        for point in &model.points {
            w.write_all(&point.id.to_le_bytes())?;
            for x in point.xyz {
                w.write_all(&x.to_le_bytes())?;
            }
            w.write_all(&point.rgb)?;
            w.write_all(&point.error.to_le_bytes())?;
            w.write_all(&(point.track.len() as u64).to_le_bytes())?;
            for (image, keypoint) in &point.track {
                w.write_all(&image.to_le_bytes())?;
                w.write_all(&keypoint.to_le_bytes())?;
            }
        }
        Ok(())
    })
}
