//! Pictures of a run: strips over time, gates as colors.

use crate::run::mixture::Pictures;
use crate::run::{Run, RunError};
use weaver_data::film::Shot;
use weaver_io::{Image, false_color};

/// The color of each expert in maps of the gate; from the fifth on they repeat.
pub const COLORS: [[f32; 3]; 4] = [[0.90, 0.36, 0.18], [0.20, 0.55, 0.86], [0.98, 0.78, 0.22], [0.30, 0.68, 0.36]];
/// Names of the colors.
pub const COLOR_NAMES: [&str; 4] = ["orange", "blue", "yellow", "green"];
/// Error of the brightest color.
const BRIGHTEST: f32 = 0.25;

impl Pictures {
    /// An expert's picture, of `size` (height, width).
    pub fn expert(&self, index: usize, size: [usize; 2]) -> Image {
        let numbers = 3 * size[0] * size[1];
        picture(&self.experts[index * numbers..][..numbers], size)
    }

    /// The mixture.
    pub fn mixture(&self, size: [usize; 2]) -> Image {
        picture(&self.mixture, size)
    }

    /// The gate: colors of the experts, blended by their shares.
    pub fn gate(&self, [height, width]: [usize; 2]) -> Image {
        let pixels = height * width;
        let color = |pixel: usize, channel: usize| -> f32 {
            self.gate.iter().skip(pixel).step_by(pixels).zip(COLORS.iter().cycle()).map(|(g, c)| g * c[channel]).sum()
        };
        let pixels = (0..pixels).flat_map(|pixel| [0, 1, 2].map(|channel| color(pixel, channel))).collect();
        Image { width, height, pixels }
    }

    /// Map of the differences between the mixture and a photo.
    pub fn error(&self, photo: &Image) -> Image {
        let difference =
            |(a, b): (&[f32], &[f32])| a.iter().zip(b).map(|(a, b)| (a.clamp(0.0, 1.0) - b).abs()).sum::<f32>() / 3.0;
        let pairs = self.mixture.chunks_exact(3).zip(photo.pixels.chunks_exact(3));
        let values: Vec<f32> = pairs.map(difference).collect();
        false_color(&values, photo.width, photo.height, 0.0, BRIGHTEST)
    }
}

fn picture(values: &[f32], [height, width]: [usize; 2]) -> Image {
    Image { width, height, pixels: values.iter().map(|x| x.clamp(0.0, 1.0)).collect() }
}

/// A strip of pictures over time, with its name.
#[derive(Clone, Debug)]
pub struct Strip {
    /// Name of the picture.
    pub name: String,
    /// Side by side.
    pub image: Image,
}

impl Run {
    /// Strips over time from one viewpoint: photos, the mixture, its errors, the gate, each expert. The viewpoint is a
    /// held-out one, if there is any, and the times are `count` of its photos'.
    ///
    /// # Errors
    /// When the rasterizer refuses, or a photo cannot be read any more.
    pub fn strips(&self, count: usize) -> Result<Vec<Strip>, RunError> {
        let shots = self.shown(count);
        let size = self.film.size;
        let mut columns = Vec::new();
        for shot in &shots {
            let pictures = self.mixture.pictures(&self.params, &shot.camera, shot.time)?;
            let photo = shot.image(size)?;
            let mut column = vec![pictures.mixture(size), pictures.error(&photo), pictures.gate(size)];
            column.extend((0..self.settings.experts.len()).map(|k| pictures.expert(k, size)));
            column.insert(0, photo);
            columns.push(column);
        }
        let fixed = ["photos", "mixture", "where they differ", "gate"].map(String::from);
        let names = fixed.into_iter().chain(self.settings.labels());
        let strip = |(i, name): (usize, String)| {
            let row: Vec<&Image> = columns.iter().map(|column| &column[i]).collect();
            Strip { name, image: Image::mosaic(&row) }
        };
        Ok(names.enumerate().map(strip).collect())
    }

    /// Photos of one viewpoint, or the held-out ones of a hand-held camera, evenly spread over time.
    fn shown(&self, count: usize) -> Vec<&Shot> {
        let all = &self.film.shots;
        let best = all.iter().find(|shot| shot.held_out.camera).or(all.first()).map(|shot| shot.viewpoint);
        let of_one: Vec<&Shot> = all.iter().filter(|shot| Some(shot.viewpoint) == best).collect();
        let held_out: Vec<&Shot> = all.iter().filter(|shot| !shot.held_out.trained()).collect();
        let among = if of_one.len() > 1 || held_out.is_empty() { of_one } else { held_out };
        weaver_data::uniform(among.len(), count.min(among.len())).iter().map(|i| among[*i]).collect()
    }
}
