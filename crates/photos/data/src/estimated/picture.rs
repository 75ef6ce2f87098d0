//! A picture of the points that were found.

use super::EstimatedPhotos;
use weaver_geometry::glam::DVec2;
use weaver_io::Image;

/// Width of a photo in the picture.
const THUMBNAIL: usize = 240;

impl EstimatedPhotos {
    /// Every photo with a camera, with the places of its points: green where these are exact, red where they are off by
    /// two pixels.
    pub fn picture(&self) -> Image {
        let [good, bad] = [[0.1, 0.9, 0.2], [1.0, 0.1, 0.1]];
        let e = &self.estimate;
        let shown: Vec<usize> = (0..self.images.len()).filter(|photo| e.cameras[*photo].is_ok()).collect();
        let height = |photo: usize| (self.images[photo].height * THUMBNAIL / self.images[photo].width).max(1);
        let tallest = shown.iter().map(|photo| height(*photo)).max().unwrap_or(1);
        let columns = (shown.len() as f64).sqrt().ceil().max(1.0) as usize;
        let rows = shown.len().div_ceil(columns).max(1);
        let mut sheet = Image::filled(columns * THUMBNAIL, rows * tallest, [1.0; 3]);
        // One after the other: a thousand thumbnails beside the sheet would take as much again.
        let mut corners = vec![[0; 2]; self.images.len()];
        for (i, photo) in shown.into_iter().enumerate() {
            corners[photo] = [i % columns * THUMBNAIL, i / columns * tallest];
            let image = &self.images[photo];
            paste(&mut sheet, &image.resize(THUMBNAIL, height(photo)).to_image(), corners[photo]);
        }
        for o in &e.observations {
            let Some(off) = self.off(o) else { continue };
            let t = (off / 2.0).min(1.0) as f32;
            let at = o.pixel * (THUMBNAIL as f64 / self.images[o.camera].width as f64);
            let color = std::array::from_fn(|c| good[c] * (1.0 - t) + bad[c] * t);
            dot(&mut sheet, corners[o.camera], height(o.camera), at, color);
        }
        sheet
    }
}

/// Draws a dot of three by three pixels into the thumbnail with this corner and height.
fn dot(sheet: &mut Image, [left, top]: [usize; 2], height: usize, at: DVec2, color: [f32; 3]) {
    for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
        let (x, y) = (at.x as isize + dx, at.y as isize + dy);
        if x >= 0 && y >= 0 && (x as usize) < THUMBNAIL && (y as usize) < height {
            let place = 3 * ((top + y as usize) * sheet.width + left + x as usize);
            sheet.pixels[place..place + 3].copy_from_slice(&color);
        }
    }
}

/// Puts an image into another one, with its corner here.
fn paste(sheet: &mut Image, image: &Image, [left, top]: [usize; 2]) {
    for (y, row) in image.pixels.chunks_exact(3 * image.width).enumerate() {
        let at = 3 * ((top + y) * sheet.width + left);
        sheet.pixels[at..at + row.len()].copy_from_slice(row);
    }
}
