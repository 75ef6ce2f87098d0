//! A shell behind everything, for sky and far background.

use crate::FitSettings;
use crate::population::logit;
use weaver_geometry::Camera;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::lens::LensCamera;
use weaver_kernels::order::nth;
use weaver_kernels::parallel;
use weaver_scene::{Gaussians, Photo, forms};

/// Cells along the longer side of a photo: what lies within one counts as one color.
const CELLS: usize = 48;
/// Photos that are asked, evenly spread.
const ASKED: usize = 64;
/// Radius over the farthest Gaussians' distance, without the last twentieth, and over the spread of the cameras.
const BEHIND: f64 = 2.0;
const BEYOND: f64 = 10.0;
/// Difference of colors, of 1, up to which photos agree, and the part of them that has to.
const ALIKE: f32 = 0.1;
const AGREE: f64 = 0.75;
/// Photos that have to agree, at least: behind the edge of a single one anything may stand.
const PHOTOS: usize = 2;
/// Mean of the photos' upward axes below which they have no common one.
const UPRIGHT: f64 = 0.3;
/// Directions of a task.
const GRAIN: usize = 64;
/// Standard deviation over the distance of neighbors on the shell: their sum is even.
const WIDTH: f64 = 0.7;
/// Part of the largest number of Gaussians that the shell may have, and the least number: fewer are no sky.
const PART: f64 = 0.1;
const FEWEST: usize = 50;

/// Gaussians on a sphere far behind a scene, in the directions in which photos agree about a color and have nothing of
/// `start` before it: sky and far background, which have no points to begin on.
///
/// They stand as far apart as the 48th part of a photo, or farther if there are too many. A photo shows nothing near in
/// a direction if no Gaussian stands there, nor above it up to the edge of the photo: a wall without points looks like
/// sky, but has an edge above. A direction counts if two such photos, and three quarters of them, show one color.
/// Masked pixels say nothing. Photos whose upward axes differ too much to have a common one get no shell.
pub fn sky(photos: &[Photo], start: &Gaussians, settings: &FitSettings) -> Gaussians {
    let asked = photos.len().min(ASKED);
    let photos: Vec<&Photo> = (0..asked).map(|i| &photos[i * photos.len() / asked]).collect();
    let Some(shell) = Shell::around(&photos, start) else { return Gaussians::default() };
    let mut sights: Vec<Option<Sight>> = photos.iter().map(|_| None).collect();
    parallel::for_chunks(&mut sights, 1, |i, sight| sight[0] = Some(Sight::new(photos[i], start, shell.up)));
    let sights: Vec<Sight> = sights.into_iter().flatten().collect();
    let most = ((PART * settings.gaussians as f64) as usize).min(settings.gaussians.saturating_sub(start.len()));
    let mut apart = sights.iter().map(|sight| sight.cell_angle).fold(f64::INFINITY, f64::min);
    loop {
        let found = shell.seen(apart, &sights);
        if found.len() < FEWEST {
            return Gaussians::default();
        }
        if found.len() <= most {
            return shell.gaussians(&found, apart, settings);
        }
        // Their number falls with the square of the distance.
        apart *= (found.len() as f64 / most as f64).sqrt().max(1.05);
    }
}

/// A sphere around a scene, and its upward axis.
struct Shell {
    center: DVec3,
    radius: f64,
    up: DVec3,
}

impl Shell {
    /// `None` where all cameras and Gaussians are in one place, or photos have no common upward axis.
    fn around(photos: &[&Photo], start: &Gaussians) -> Option<Self> {
        let centers: Vec<DVec3> = photos.iter().map(|photo| photo.camera.pose.center()).collect();
        let center = centers.iter().sum::<DVec3>() / centers.len().max(1) as f64;
        let spread = centers.iter().map(|other| other.distance(center)).fold(0.0, f64::max);
        let mut distances: Vec<f64> =
            start.means.iter().map(|mean| DVec3::from(mean.map(f64::from)).distance(center)).collect();
        let last = distances.len().saturating_sub(1 + distances.len() / 20);
        let far = nth(&mut distances, last).unwrap_or(0.0);
        let radius = (BEHIND * far).max(BEYOND * spread);
        let up = -photos.iter().map(|photo| photo.camera.pose.rotation.row(1)).sum::<DVec3>();
        if !(radius > 0.0 && radius.is_finite() && up.length() > UPRIGHT * photos.len() as f64) {
            return None;
        }
        Some(Self { center, radius, up: up.normalize() })
    }

    /// Points of the sphere, so many radians apart, that photos show, with their colors.
    fn seen(&self, apart: f64, sights: &[Sight]) -> Vec<(DVec3, [f32; 3])> {
        let count = (4.0 * std::f64::consts::PI / (apart * apart)).ceil().max(1.0) as usize;
        let mut seen = vec![None; count];
        parallel::for_chunks(&mut seen, GRAIN, |chunk, seen| {
            for (i, seen) in seen.iter_mut().enumerate() {
                let point = self.center + self.radius * spiral(GRAIN * chunk + i, count);
                let colors: Vec<[f32; 3]> = sights.iter().filter_map(|sight| sight.open(point)).collect();
                *seen = agreed(&colors).map(|color| (point, color));
            }
        });
        seen.into_iter().flatten().collect()
    }

    fn gaussians(&self, found: &[(DVec3, [f32; 3])], apart: f64, settings: &FitSettings) -> Gaussians {
        let scale = (WIDTH * apart * self.radius).ln() as f32;
        Gaussians {
            means: found.iter().map(|(point, _)| point.as_vec3().to_array()).collect(),
            log_scales: vec![[scale; 3]; found.len()],
            quats: vec![[1.0, 0.0, 0.0, 0.0]; found.len()],
            opacity_logits: vec![logit(settings.initial_opacity); found.len()],
            sh: found.iter().flat_map(|(_, color)| color.map(forms::harmonic)).collect(),
            degree: 0,
        }
    }
}

/// A direction of `count` that are spread evenly.
///
/// Source: González, Measurement of areas on a sphere using Fibonacci and latitude-longitude lattices, 2010.
fn spiral(i: usize, count: usize) -> DVec3 {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let z = 1.0 - (2 * i + 1) as f64 / count as f64;
    let (sine, cosine) = (golden * i as f64).sin_cos();
    let across = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(across * cosine, across * sine, z)
}

/// The color that most of these are alike to; `None` if they are too different, or too few.
fn agreed(colors: &[[f32; 3]]) -> Option<[f32; 3]> {
    let alike = |a: &[f32; 3], b: &[f32; 3]| (0..3).all(|c| (a[c] - b[c]).abs() < ALIKE);
    let near = |color: &[f32; 3]| colors.iter().filter(|other| alike(color, other)).count();
    let best = colors.iter().max_by_key(|color| near(color))?;
    let group: Vec<&[f32; 3]> = colors.iter().filter(|other| alike(best, other)).collect();
    let enough = group.len() >= PHOTOS && group.len() as f64 >= AGREE * colors.len() as f64;
    enough.then(|| std::array::from_fn(|c| group.iter().map(|color| color[c]).sum::<f32>() / group.len() as f32))
}

/// The cells of a photo.
struct Sight {
    camera: LensCamera,
    /// Pixels of a side of a cell, and cells of a row.
    cell: usize,
    columns: usize,
    /// Color of a cell that shows nothing near, and above which the photo shows nothing near.
    open: Vec<Option<[f32; 3]>>,
    /// Angle of a cell, radians.
    cell_angle: f64,
}

impl Sight {
    fn new(photo: &Photo, start: &Gaussians, up: DVec3) -> Self {
        let (width, height) = (photo.camera.width, photo.camera.height);
        let cell = width.max(height).div_ceil(CELLS).max(1);
        let (columns, rows) = (width.div_ceil(cell), height.div_ceil(cell));
        let cell_angle = cell as f64 / photo.camera.intrinsics.fx;
        let mut sight = Self { camera: photo.lens_camera(), cell, columns, open: Vec::new(), cell_angle };
        let mut near = vec![false; columns * rows];
        for mean in &start.means {
            let local = photo.camera.pose.apply(DVec3::from(mean.map(f64::from)));
            let Some((at, _)) = sight.camera.see(local) else { continue };
            let [x, y] = [at.x, at.y].map(|at| (at / cell as f64).floor());
            // What stands in a cell hides the ones around it: points are fewer than surfaces are large.
            for [x, y] in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| [x + f64::from(dx), y + f64::from(dy)])) {
                if x >= 0.0 && y >= 0.0 && x < columns as f64 && y < rows as f64 {
                    near[y as usize * columns + x as usize] = true;
                }
            }
        }
        let up = photo.camera.pose.rotation * up;
        let open = |i: &usize| !near[*i] && sight.above(*i, up).all(|above| !near[above]);
        let colors = (0..columns * rows).map(|i| Some(i).filter(open).and_then(|i| sight.color(photo, i))).collect();
        sight.open = colors;
        sight
    }

    /// The cells that follow toward the zenith, to the edge of the photo.
    fn above(&self, cell: usize, up: DVec3) -> impl Iterator<Item = usize> {
        let middle = |i: usize| (i as f64 + 0.5) * self.cell as f64;
        let pixel = DVec2::new(middle(cell % self.columns), middle(cell / self.columns));
        let ray = self.camera.point(pixel, 1.0).map(DVec3::normalize);
        ray.into_iter().flat_map(move |ray| {
            // Along the great circle through the zenith.
            let tangent = (up - ray * ray.dot(up)).normalize_or_zero();
            let steps = (ray.angle_between(up) / self.cell_angle) as usize;
            let turned = move |step: usize| {
                let (sine, cosine) = (step as f64 * self.cell_angle).sin_cos();
                self.cell_of(ray * cosine + tangent * sine)
            };
            (1..=steps).map_while(turned)
        })
    }

    /// The cell that shows a point of camera coordinates.
    fn cell_of(&self, local: DVec3) -> Option<usize> {
        let (at, _) = self.camera.see(local)?;
        let Camera { width, height, .. } = self.camera.camera;
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < width as f64 && at.y < height as f64;
        inside.then(|| at.y as usize / self.cell * self.columns + at.x as usize / self.cell)
    }

    /// The color of the photo where it shows a point with nothing near before it.
    fn open(&self, point: DVec3) -> Option<[f32; 3]> {
        self.open[self.cell_of(self.camera.camera.pose.apply(point))?]
    }

    /// Mean color of a cell; `None` if any of its pixels does not count.
    fn color(&self, photo: &Photo, cell: usize) -> Option<[f32; 3]> {
        let (width, height) = (photo.camera.width, photo.camera.height);
        let [column, row] = [cell % self.columns, cell / self.columns].map(|i| i * self.cell);
        let (mut sum, mut count) = ([0_u32; 3], 0);
        for y in row..(row + self.cell).min(height) {
            for x in column..(column + self.cell).min(width) {
                let at = y * width + x;
                if photo.mask.as_ref().is_some_and(|mask| !mask[at]) {
                    return None;
                }
                (0..3).for_each(|c| sum[c] += u32::from(photo.rgb[3 * at + c]));
                count += 1;
            }
        }
        Some(sum.map(|sum| sum as f32 / (255 * count) as f32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::glam::DMat3;
    use weaver_geometry::{Intrinsics, Pose};

    const SIZE: usize = 64;

    /// Photos from a row of places: the upper half is of this color, the lower gray.
    fn photos(upper: impl Fn(usize) -> [u8; 3]) -> Vec<Photo> {
        let intrinsics = Intrinsics { fx: 64.0, fy: 64.0, cx: 32.0, cy: 32.0 };
        let photo = |i: usize| {
            let pose = Pose::new(DMat3::IDENTITY, DVec3::new(-0.2 * i as f64, 0.0, 0.0));
            let camera = Camera { pose, intrinsics, width: SIZE, height: SIZE };
            let pixel = |at: usize| if at < SIZE * SIZE / 2 { upper(i) } else { [100; 3] };
            let rgb: Vec<u8> = (0..SIZE * SIZE).flat_map(pixel).collect();
            Photo { name: "photo".into(), camera, rgb: rgb.into(), mask: None, lens: None }
        };
        (0..5).map(photo).collect()
    }

    /// Gaussians of a wall over the lower half of all photos.
    fn wall() -> Gaussians {
        let means: Vec<[f32; 3]> =
            (0..60 * 30).map(|i| [0.1 * (i % 60) as f32 - 2.5, 0.1 * (i / 60) as f32 + 0.05, 4.0]).collect();
        let n = means.len();
        Gaussians {
            means,
            log_scales: vec![[-3.0; 3]; n],
            quats: vec![[1.0, 0.0, 0.0, 0.0]; n],
            opacity_logits: vec![0.0; n],
            sh: vec![0.0; 3 * n],
            degree: 0,
        }
    }

    /// Promise (scenes): sky begins behind everything in its own color, and nothing is put behind surfaces.
    #[test]
    fn sky_begins_where_nothing_else_is() {
        let shell = sky(&photos(|_| [250, 240, 230]), &wall(), &FitSettings::default());
        assert!(shell.len() > 100 && shell.lengths_agree());
        for (mean, color) in shell.means.iter().zip(shell.sh.chunks_exact(3)) {
            assert!(mean[1] < 0.0 && mean[2] > 8.0, "{mean:?} is not above the wall, far behind it");
            for (found, expected) in color.iter().zip([250.0, 240.0, 230.0]) {
                assert!((found - forms::harmonic(expected / 255.0)).abs() < 1e-4);
            }
        }
        // They cover what the photos see: an axis that looks up a little meets one within its width.
        let (ray, width) = (DVec3::new(0.0, -0.2, 1.0).normalize(), f64::from(shell.log_scales[0][0]).exp());
        let off = |mean: &[f32; 3]| {
            let mean = DVec3::from(mean.map(f64::from));
            (mean - ray * mean.dot(ray)).length()
        };
        assert!(shell.means.iter().map(off).fold(f64::INFINITY, f64::min) < width);
    }

    #[test]
    fn sky_needs_photos_that_agree() {
        let loud = |i: usize| [[250, 0, 0], [0, 250, 0], [0, 0, 250], [250, 250, 0], [0, 250, 250]][i];
        let alone = sky(&photos(loud), &wall(), &FitSettings::default());
        // Above the ends of the row one photo alone shows something.
        let middle = |mean: &[f32; 3]| mean[0].abs() < 0.2 * mean[2];
        assert!(!alone.means.iter().any(middle), "photos of five colors show no common one");
        let masked = photos(|_| [250; 3]).into_iter();
        let masked: Vec<Photo> = masked.map(|photo| Photo { mask: Some(vec![false; SIZE * SIZE]), ..photo }).collect();
        assert!(sky(&masked, &wall(), &FitSettings::default()).is_empty());
        assert!(sky(&[], &wall(), &FitSettings::default()).is_empty());
    }

    #[test]
    fn the_budget_bounds_the_sky() {
        let settings = FitSettings { gaussians: 2000, ..FitSettings::default() };
        let shell = sky(&photos(|_| [250; 3]), &wall(), &settings);
        assert!(!shell.is_empty() && shell.len() <= 200, "{}", shell.len());
        let full = FitSettings { gaussians: wall().len(), ..FitSettings::default() };
        assert!(sky(&photos(|_| [250; 3]), &wall(), &full).is_empty());
    }
}
