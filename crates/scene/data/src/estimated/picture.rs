//! A picture of the points that were found.

use super::EstimatedPhotos;
use weaver_geometry::glam::DVec2;
use weaver_io::Image;

/// Width of a photo in the picture.
const THUMBNAIL: usize = 240;

impl EstimatedPhotos {
    /// Every photo with a camera, with the places of its points: green where these are exact, red where they are off by two pixels.
    pub fn picture(&self) -> Image {
        let [good, bad] = [[0.1, 0.9, 0.2], [1.0, 0.1, 0.1]];
        let e = &self.estimate;
        let mut shown: Vec<Option<Image>> = vec![None; self.images.len()];
        for (number, image) in self.images.iter().enumerate().filter(|(number, _)| e.cameras[*number].is_ok()) {
            let height = (image.height * THUMBNAIL / image.width).max(1);
            shown[number] =
                Some(image.to_image().resize(THUMBNAIL, height, [0.0, 0.0, image.width as f64, image.height as f64]));
        }
        for o in &e.observations {
            let (Some(shown), Some(off)) = (&mut shown[o.camera], self.off(o)) else { continue };
            let t = (off / 2.0).min(1.0) as f32;
            let at = o.pixel * (shown.width as f64 / self.images[o.camera].width as f64);
            dot(shown, at, std::array::from_fn(|c| good[c] * (1.0 - t) + bad[c] * t));
        }
        let shown: Vec<Image> = shown.into_iter().flatten().collect();
        sheet(&shown)
    }
}

/// Draws a dot of three by three pixels.
fn dot(image: &mut Image, at: DVec2, color: [f32; 3]) {
    for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
        let (x, y) = (at.x as isize + dx, at.y as isize + dy);
        if x >= 0 && y >= 0 && (x as usize) < image.width && (y as usize) < image.height {
            let place = 3 * (y as usize * image.width + x as usize);
            image.pixels[place..place + 3].copy_from_slice(&color);
        }
    }
}

/// Pictures side by side in rows.
fn sheet(images: &[Image]) -> Image {
    let columns = (images.len() as f64).sqrt().ceil().max(1.0) as usize;
    let height = images.iter().map(|i| i.height).max().unwrap_or(1);
    let rows = images.len().div_ceil(columns).max(1);
    let mut sheet = Image::filled(columns * THUMBNAIL, rows * height, [1.0; 3]);
    for (i, image) in images.iter().enumerate() {
        let (left, top) = (i % columns * THUMBNAIL, i / columns * height);
        for (y, row) in image.pixels.chunks_exact(3 * image.width).enumerate() {
            let at = 3 * ((top + y) * sheet.width + left);
            sheet.pixels[at..at + row.len()].copy_from_slice(row);
        }
    }
    sheet
}
