//! Photos of a fisheye lens.

use super::loading::Loaded;
use crate::Error;
use crate::spheres::Face;
use std::path::PathBuf;
use weaver_geometry::Camera;
use weaver_geometry::glam::DVec2;
use weaver_sfm::FisheyeLens;

/// The brightest value, of 255, of pixels outside of a lens's circle.
const BLACK: u8 = 16;
/// Pixels by which the circle is narrowed, over the longer side: its rim is no thing in the world.
const RIM: f64 = 0.015;
/// Photos that tell a circle, at least: one may be dark in a corner.
const FEWEST: usize = 3;

/// The lens of a camera that was found.
pub(super) fn lens(camera: &Camera, k: [f64; 4]) -> FisheyeLens {
    let lens = FisheyeLens::new([camera.height, camera.width], camera.intrinsics.fx);
    FisheyeLens { center: DVec2::new(camera.intrinsics.cx, camera.intrinsics.cy), k, ..lens }
}

/// The field of view across the longer side, degrees: of the largest angle, if the lens's circle is narrower.
pub(super) fn field_of_view(camera: &Camera, k: [f64; 4]) -> f64 {
    let lens = lens(camera, k);
    let middle = lens.center;
    let ends = match camera.width >= camera.height {
        true => [DVec2::new(0.0, middle.y), DVec2::new(camera.width as f64, middle.y)],
        false => [DVec2::new(middle.x, 0.0), DVec2::new(middle.x, camera.height as f64)],
    };
    let angle = |end: DVec2| lens.ray(end).map_or(lens.last_angle(), |ray| ray.truncate().length().atan2(ray.z));
    ends.map(angle).iter().sum::<f64>().to_degrees()
}

/// Checks that photos may be of one fisheye, and masks what is black in all of them: the surroundings of its circle.
///
/// # Errors
/// Names the first photo of another size, or a panorama.
pub(super) fn prepare(paths: &[PathBuf], faces: &[Option<Face>], loaded: &mut [Loaded]) -> Result<(), Error> {
    let expected = "photos of one fisheye lens, all of one size (--lens fisheye)";
    if let Some(face) = faces.iter().flatten().next() {
        return Err(Error::unexpected(&face.panorama, "photos", expected, "a panorama"));
    }
    let size = |photo: &Loaded| (photo.image.width, photo.image.height);
    let Some(first) = loaded.first().map(size) else { return Ok(()) };
    if let Some(other) = loaded.iter().position(|photo| size(photo) != first) {
        let [a, b] = [&loaded[0], &loaded[other]].map(|photo| format!("{} x {}", photo.size.0, photo.size.1));
        let found = format!("{b} pixels beside {a} of {}", paths[0].display());
        return Err(Error::unexpected(&paths[other], "photos", expected, found));
    }
    if loaded.len() < FEWEST {
        return Ok(());
    }
    let (width, height) = first;
    let bright = |i: usize| loaded.iter().any(|photo| photo.image.pixels[3 * i..3 * i + 3].iter().any(|x| *x > BLACK));
    let shown: Vec<bool> = (0..width * height).map(bright).collect();
    if !shown.contains(&false) {
        return Ok(());
    }
    let inside = narrowed(&shown, width, (RIM * width.max(height) as f64).ceil() as usize);
    for photo in loaded {
        match &mut photo.mask {
            Some(mask) => mask.iter_mut().zip(&inside).for_each(|(counts, inside)| *counts &= inside),
            None => photo.mask = Some(inside.clone()),
        }
    }
    Ok(())
}

/// A mask without the pixels that are so near to one outside of it, along rows and then along columns.
fn narrowed(mask: &[bool], width: usize, by: usize) -> Vec<bool> {
    let height = mask.len() / width;
    let along = |mask: &[bool], length: usize, at: &dyn Fn(usize) -> usize| -> Vec<bool> {
        (0..length).map(|i| (i.saturating_sub(by)..(i + by + 1).min(length)).all(|j| mask[at(j)])).collect()
    };
    let mut rows = Vec::with_capacity(mask.len());
    for y in 0..height {
        rows.extend(along(mask, width, &|x| y * width + x));
    }
    let mut all = rows.clone();
    for x in 0..width {
        let column = along(&rows, height, &|y| y * width + x);
        column.into_iter().enumerate().for_each(|(y, inside)| all[y * width + x] = inside);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_is_narrowed_on_all_sides() {
        let mask: Vec<bool> = (0..12 * 9).map(|i| (2..10).contains(&(i % 12)) && (1..8).contains(&(i / 12))).collect();
        let narrow = narrowed(&mask, 12, 2);
        let expected: Vec<bool> =
            (0..12 * 9).map(|i| (4..8).contains(&(i % 12)) && (3..6).contains(&(i / 12))).collect();
        assert_eq!(narrow, expected);
        assert_eq!(narrowed(&[true; 20], 5, 2), [true; 20], "nothing is narrowed from the border of a photo");
    }
}
