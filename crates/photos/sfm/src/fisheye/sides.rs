//! Fisheye photos as rigs of pinhole photos: the sides of a cube.

use super::adjust::{Adjustment, Sight};
use super::lens::FisheyeLens;
use crate::bundle::Mounted;
use crate::estimate::{Estimate, LeftOut};
use crate::features::{Features, Keypoint};
use crate::photo::Photo;
use std::borrow::Cow;
use weaver_geometry::Pose;
use weaver_geometry::glam::{DMat3, DVec2, DVec3};

/// Sides of a photo: ahead, right, left, above and below. Nothing behind.
const SIDES: usize = 5;
/// Half the field of view of a side, as a tangent: a right angle leaves nothing out.
const HALF: f64 = 1.0;
/// A step of this length, pixels, by which magnification is measured.
const STEP: f64 = 0.5;

/// Rotation from the axes of the photo to a side's.
fn rotation(side: usize) -> DMat3 {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let (right, down) = [(x, y), (-z, y), (z, y), (x, z), (x, -z)][side];
    DMat3::from_cols(right, down, right.cross(down)).transpose()
}

/// Photos and features of all sides.
pub(super) struct Sides {
    lens: FisheyeLens,
    /// Five for each photo.
    pub photos: Vec<Photo<'static>>,
    pub features: Vec<Features>,
    /// The keypoint of the photo that each keypoint of a side is.
    pixels: Vec<Vec<Keypoint>>,
    /// Pixels of a side.
    size: usize,
}

impl Sides {
    /// The sides of photos with these features, by a lens that is roughly known.
    pub fn of(photos: &[Photo<'_>], features: &[Features], lens: FisheyeLens) -> Self {
        // As many pixels for an angle as the photo has in its middle.
        let size = (2.0 * HALF * lens.focal).round().max(16.0) as usize;
        let mut sides = Self { lens, photos: Vec::new(), features: Vec::new(), pixels: Vec::new(), size };
        let gray = vec![128; 3 * size * size];
        for (number, (photo, features)) in photos.iter().zip(features).enumerate() {
            let mut of_sides: [(Features, Vec<Keypoint>); SIDES] = Default::default();
            for (keypoint, descriptor) in
                features.keypoints.iter().zip(features.descriptors.chunks_exact(crate::DESCRIPTOR))
            {
                let Some((side, moved)) = sides.moved(keypoint) else { continue };
                let (features, pixels) = &mut of_sides[side];
                features.keypoints.push(moved);
                features.descriptors.extend_from_slice(descriptor);
                pixels.push(*keypoint);
            }
            for (side, (features, pixels)) in of_sides.into_iter().enumerate() {
                let mounted = Some(Mounted { on: SIDES * number, rotation: rotation(side) });
                let focal = Some(sides.focal());
                let of_side = Photo::new(Cow::Owned(gray.clone()), [size, size]);
                sides.photos.push(Photo { focal, mounted, located: photo.located, ..of_side });
                sides.features.push(features);
                sides.pixels.push(pixels);
            }
        }
        sides
    }

    fn focal(&self) -> f64 {
        0.5 * self.size as f64 / HALF
    }

    /// The side that shows a keypoint, and the keypoint there.
    fn moved(&self, keypoint: &Keypoint) -> Option<(usize, Keypoint)> {
        let ray = self.lens.ray(keypoint.pixel)?;
        let side = (0..SIDES).max_by(|a, b| (rotation(*a) * ray).z.total_cmp(&(rotation(*b) * ray).z))?;
        let pixel = self.pixel(side, ray)?;
        // By how much a step along and across grows.
        let step = |by: DVec2| self.pixel(side, self.lens.ray(keypoint.pixel + by)?).map(|at| at - pixel);
        let larger = match (step(DVec2::X * STEP), step(DVec2::Y * STEP)) {
            (Some(a), Some(b)) => a.perp_dot(b).abs().sqrt() / STEP,
            _ => 1.0,
        };
        Some((side, Keypoint { pixel, scale: keypoint.scale * larger, ..*keypoint }))
    }

    fn pixel(&self, side: usize, ray: DVec3) -> Option<DVec2> {
        let p = rotation(side) * ray;
        let middle = DVec2::splat(0.5 * self.size as f64);
        let at = middle + p.truncate() / p.z * self.focal();
        (p.z > 0.0 && at.is_finite()).then_some(at)
    }

    /// Cameras, points and observations of an estimate of the sides, in pixels of the fisheye.
    pub fn adjustment(&self, estimate: &Estimate, photos: usize) -> Adjustment {
        let pose = |photo: usize| estimate.cameras[SIDES * photo].ok().map(|camera| camera.pose);
        let poses: Vec<Option<Pose>> = (0..photos).map(pose).collect();
        let mut sights = Vec::new();
        for o in &estimate.observations {
            let of_side = &self.features[o.camera].keypoints;
            // Observations keep the pixels of keypoints to the bit, unless their surroundings were aligned.
            let Some(number) = of_side.iter().position(|keypoint| keypoint.pixel == o.pixel) else { continue };
            let keypoint = self.pixels[o.camera][number];
            let deviation = o.deviation * keypoint.scale / of_side[number].scale;
            sights.push(Sight { photo: o.camera / SIDES, point: o.point, pixel: keypoint.pixel, deviation });
        }
        Adjustment { lens: self.lens, poses, points: estimate.points.clone(), sights }
    }

    /// An estimate of the sides as one of the photos; observations stay in pixels of sides.
    pub fn of_photos(&self, estimate: Estimate) -> Estimate {
        let first = |i: usize| SIDES * i;
        let photos = self.photos.len() / SIDES;
        let reason = |i: usize| {
            let reasons: Vec<LeftOut> =
                estimate.cameras[first(i)..first(i + 1)].iter().filter_map(|c| c.err()).collect();
            // The sides that were compared say most.
            let most = [LeftOut::Unplaced, LeftOut::OnePlace, LeftOut::Unmatched];
            most.into_iter().find(|reason| reasons.contains(reason)).unwrap_or(LeftOut::Textureless)
        };
        let cameras = (0..photos).map(|i| estimate.cameras[first(i)].map_err(|_| reason(i))).collect();
        let uncertainty = estimate.uncertainty.map(|mut u| {
            u.rotations = u.rotations.into_iter().step_by(SIDES).collect();
            u.centers = u.centers.into_iter().step_by(SIDES).collect();
            u
        });
        let untied = estimate.untied.iter().map(|photo| photo / SIDES).collect();
        let distortion = vec![None; photos];
        let seen = vec![0; photos];
        Estimate { cameras, distortion, uncertainty, untied, seen, ..estimate }
    }
}
