//! Pictures of trajectories, maps and range images.

use weaver_geometry::Pose;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_io::{Image, false_color};

const SIDE: f64 = 640.0;

/// A sheet with coordinates of the world, x to the right, y up.
pub(crate) struct Sheet {
    image: Image,
    corner: DVec2,
    scale: f64,
}

impl Sheet {
    /// A white sheet for points between two corners, at most 640 pixels wide and high.
    pub fn new(low: DVec2, high: DVec2) -> Self {
        let size = (high - low).max(DVec2::splat(1e-3));
        let scale = (SIDE - 40.0) / size.max_element();
        let pixels = size * scale + 40.0;
        let corner = DVec2::new(low.x - 20.0 / scale, high.y + 20.0 / scale);
        Self { image: Image::filled(pixels.x as usize, pixels.y as usize, [1.0; 3]), corner, scale }
    }

    /// Pixels per meter.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    pub fn dot(&mut self, at: DVec2, radius: i32, color: [f32; 3]) {
        let (x, y) = ((at.x - self.corner.x) * self.scale, (self.corner.y - at.y) * self.scale);
        for dy in -radius..=radius {
            for dx in -radius..=radius {
                let (column, row) = (x as i32 + dx, y as i32 + dy);
                let inside = column >= 0 && row >= 0;
                if inside && (column as usize) < self.image.width && (row as usize) < self.image.height {
                    let first = 3 * (row as usize * self.image.width + column as usize);
                    self.image.pixels[first..first + 3].copy_from_slice(&color);
                }
            }
        }
    }

    pub fn line(&mut self, points: impl Iterator<Item = DVec2>, radius: i32, color: [f32; 3]) {
        let mut last: Option<DVec2> = None;
        for p in points {
            if let Some(from) = last {
                let steps = ((p - from).length() * self.scale).ceil().clamp(1.0, 4000.0);
                (0..=steps as usize).for_each(|i| self.dot(from.lerp(p, i as f64 / steps), radius, color));
            }
            last = Some(p);
        }
    }

    pub fn image(self) -> Image {
        self.image
    }
}

/// Trajectories from above: the reference in gray, the estimate in blue, keyframes in red.
pub(crate) fn trajectory(poses: &[Pose], reference: &[Pose], keyframes: &[usize]) -> (Image, f64) {
    let flat = |pose: &Pose| pose.translation.truncate();
    let all = || poses.iter().chain(reference).map(flat);
    let low = all().fold(DVec2::INFINITY, DVec2::min);
    let high = all().fold(DVec2::NEG_INFINITY, DVec2::max);
    let mut sheet = Sheet::new(low, high);
    sheet.line(reference.iter().map(flat), 2, [0.75; 3]);
    sheet.line(poses.iter().map(flat), 0, [0.1, 0.3, 0.9]);
    keyframes.iter().for_each(|i| sheet.dot(flat(&poses[*i]), 3, [0.85, 0.1, 0.1]));
    let scale = sheet.scale();
    (sheet.image(), scale)
}

/// Centers of surfels on two of the axes, darker at higher density.
pub(crate) fn map(centers: &[f32], axes: [usize; 2]) -> Image {
    let points = || centers.chunks_exact(3).map(|c| DVec2::new(c[axes[0]].into(), c[axes[1]].into()));
    let low = points().fold(DVec2::INFINITY, DVec2::min);
    let high = points().fold(DVec2::NEG_INFINITY, DVec2::max);
    let mut sheet = Sheet::new(low, high);
    points().for_each(|p| sheet.dot(p, 0, [0.15, 0.2, 0.3]));
    sheet.image()
}

/// A range image in colors up to `most` meters, with rows doubled for visibility.
pub(crate) fn ranges(range: &[f32], width: usize, most: f32) -> Image {
    tall(false_color(range, width, range.len() / width, 0.0, most), range)
}

/// Differences of ranges at pixels with both, gray for equal ones, in colors up to `most` meters.
pub(crate) fn differences(drawn: &[f32], measured: &[f32], width: usize, most: f32) -> Image {
    let of = |(a, b): (&f32, &f32)| if *a > 0.0 && *b > 0.0 { (a - b).abs().max(1e-6) } else { 0.0 };
    let values: Vec<f32> = drawn.iter().zip(measured).map(of).collect();
    ranges(&values, width, most)
}

/// Normals as colors.
pub(crate) fn normals(normals: &[f32], width: usize) -> Image {
    let pixels = normals.chunks_exact(3).flat_map(|n| {
        let n = DVec3::new(n[0].into(), n[1].into(), n[2].into());
        match n.length() > 0.5 {
            true => (0.5 + 0.5 * n.normalize()).to_array().map(|x| x as f32),
            false => [0.0; 3],
        }
    });
    let image = Image { width, height: normals.len() / 3 / width, pixels: pixels.collect() };
    tall(image, &vec![1.0; normals.len() / 3])
}

/// Every row twice, black at pixels without a value.
fn tall(image: Image, values: &[f32]) -> Image {
    let Image { width, height, pixels } = image;
    let row = |y: usize| {
        let row = (0..width).flat_map(move |x| (0..3).map(move |c| (y * width + x, c)));
        row.map(|(i, c)| if values[i] > 0.0 { pixels[3 * i + c] } else { 0.0 }).collect::<Vec<f32>>()
    };
    let rows: Vec<f32> = (0..height).flat_map(|y| row(y).repeat(2)).collect();
    Image { width, height: 2 * height, pixels: rows }
}
