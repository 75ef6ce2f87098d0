//! The surface below each Gaussian's pixels: how large it is in the world and how it lies.

use crate::{Patches, Routes};
use glam::{DMat3, DQuat, DVec3};
use weaver_autograd::Real;
use weaver_kernels::parallel;
use weaver_router::{COARSEST, Cells};

/// Levels of cells.
const LEVELS: usize = COARSEST as usize + 1;
/// Numbers that describe a cell to the experts: its level, one of five; the standard deviations of its colors; how much
/// its luma changes along and across its direction; and how much longer its surface is than one that faces the camera,
/// along and across.
pub(crate) const DESCRIPTORS: usize = LEVELS + 3 + 2 + 2;
/// Longest step on a surface from one pixel to the next, in footprints: a longer one is an edge, or seen too flatly.
const LONGEST: f64 = 3.0;
/// Shortest step, in footprints.
const SHORTEST: f64 = 0.25;
/// Extent along the normal over the shorter one along the surface.
const THICKNESS: f64 = 0.5;
/// Cells per parallel chunk.
const GRAIN: usize = 64;

/// Maps of every pixel of a scene.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface<'a, T> {
    /// Points `[P, 3]`, in world units.
    pub points: &'a [T],
    /// depth / fx `[P]`, in world units.
    pub footprints: &'a [T],
    /// Colors `[P, 3]`, 0 to 1.
    pub colors: &'a [T],
    /// Rows of a view.
    pub height: usize,
    /// Columns of a view.
    pub width: usize,
}

/// Initial extents, rotations and shifts of Gaussians: constants of the decoding.
#[derive(Debug)]
pub(crate) struct Frames<T> {
    /// Extents along the three axes `[N, 3]`, in world units: along the cell's bands, across them, along the normal; of
    /// the only Gaussian of a single pixel, its footprint along all three.
    pub extents: Vec<T>,
    /// Rotations from the axes to the world as unit quaternions wxyz `[N, 4]`.
    pub rotations: Vec<T>,
    /// From the mean of each Gaussian's points to where it starts `[N, 3]`, in world units.
    pub shifts: Vec<T>,
    /// Descriptors of each routed cell `[R, 12]`.
    pub descriptors: Vec<T>,
}

/// The part of a surface that a cell shows.
#[derive(Clone, Copy, Default)]
struct Facet {
    /// Along the bands, across them, and the normal.
    axes: DMat3,
    /// Length of a pixel's step along and across, in world units.
    steps: [f64; 2],
    /// Mean footprint of its pixels.
    footprint: f64,
}

impl<T: Real> Surface<'_, T> {
    fn point(&self, p: usize) -> DVec3 {
        DVec3::from_array([0, 1, 2].map(|a| self.points[3 * p + a].to_f64()))
    }

    fn color(&self, p: usize) -> DVec3 {
        DVec3::from_array([0, 1, 2].map(|c| self.colors[3 * p + c].to_f64()))
    }

    /// Row and column of a pixel.
    fn place(&self, p: usize) -> [usize; 2] {
        [p / self.width % self.height, p % self.width]
    }

    /// The steps on the surface from pixel p to the next column and to the next row: the shorter one of those on both
    /// sides, which does not jump over an edge.
    fn steps(&self, p: usize) -> [DVec3; 2] {
        let [row, column] = self.place(p);
        let (own, longest) = (self.point(p), LONGEST * self.footprints[p].to_f64());
        let along = |at: usize, end: usize, stride: usize| {
            let before = (at > 0).then(|| own - self.point(p - stride));
            let after = (at + 1 < end).then(|| self.point(p + stride) - own);
            let shorter = before.into_iter().chain(after).min_by(|a, b| a.length().total_cmp(&b.length()));
            shorter.unwrap_or_default().clamp_length_max(longest)
        };
        [along(column, self.width, 1), along(row, self.height, self.width)]
    }

    /// The facet of a cell whose bands lie across a direction of the image.
    fn facet(&self, pixels: &[u32], angle: f64) -> Facet {
        let n = pixels.len() as f64;
        let (mut right, mut down, mut footprint) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for &p in pixels {
            let [x, y] = self.steps(p as usize);
            (right, down) = (right + x / n, down + y / n);
            footprint += self.footprints[p as usize].to_f64() / n;
        }
        let (sin, cos) = angle.sin_cos();
        let (along, across) = (down * cos - right * sin, right * cos + down * sin);
        let (lost, unit) = (DMat3::IDENTITY, [footprint; 2]);
        let lengths = |steps: [f64; 2]| steps.map(|s| s.clamp(SHORTEST * footprint, LONGEST * footprint));
        let facing = Facet { axes: lost, steps: unit, footprint };
        let Some(first) = along.try_normalize() else { return facing };
        let Some(second) = across.reject_from_normalized(first).try_normalize() else { return facing };
        let axes = DMat3::from_cols(first, second, first.cross(second));
        Facet { axes, steps: lengths([along.length(), across.dot(second)]), footprint }
    }

    /// Standard deviations of the colors of a cell, and the change of its luma along and across its direction, from
    /// side to side.
    fn content(&self, pixels: &[u32], angle: f64) -> [f64; 5] {
        let n = pixels.len() as f64;
        let mean = pixels.iter().map(|&p| self.color(p as usize)).sum::<DVec3>() / n;
        let at = |p: u32| self.place(p as usize).map(|x| x as f64);
        let [row, column] = pixels.iter().map(|&p| at(p)).fold([0.0; 2], |a, b| [a[0] + b[0] / n, a[1] + b[1] / n]);
        let (mut variance, mut slope, mut size) = (DVec3::ZERO, [0.0; 2], [1e-9; 2]);
        for &p in pixels {
            let ([r, c], color) = (at(p), self.color(p as usize) - mean);
            let luma = color.dot(DVec3::new(0.299, 0.587, 0.114));
            variance += color * color / n;
            for (i, from) in [c - column, r - row].into_iter().enumerate() {
                slope[i] += from * luma;
                size[i] += from * from;
            }
        }
        let (sin, cos) = angle.sin_cos();
        let [x, y] = [0, 1].map(|i| slope[i] / size[i] * n.sqrt());
        let deviation = variance.map(f64::sqrt);
        [deviation.x, deviation.y, deviation.z, y * cos - x * sin, x * cos + y * sin]
    }

    /// The frames of all Gaussians. Extents along the surface are multiplied by `stretch` `[P]` of their pixels, if
    /// that is given.
    pub fn frames(
        &self,
        routes: &Routes,
        patches: &Patches,
        cells: Option<&Cells>,
        stretch: Option<&[T]>,
    ) -> Frames<T> {
        let level = |pixel: u32| cells.map_or(0, |cells| cells.level[pixel as usize]);
        let angle = |pixel: u32| cells.map_or(0.0, |cells| f64::from(cells.angle[pixel as usize]));
        let mut facets = vec![(Facet::default(), [0.0; DESCRIPTORS]); routes.routed.len()];
        parallel::for_chunks(&mut facets, GRAIN, |chunk, facets| {
            for (i, (facet, described)) in facets.iter_mut().enumerate() {
                let cell = GRAIN * chunk + i;
                let (pixels, angle) = (patches.cell.of(cell), angle(routes.routed[cell]));
                *facet = self.facet(pixels, angle);
                described[usize::from(level(routes.routed[cell]))] = 1.0;
                described[LEVELS..LEVELS + 5].copy_from_slice(&self.content(pixels, angle));
                for (out, step) in described[LEVELS + 5..].iter_mut().zip(facet.steps) {
                    *out = step / facet.footprint - 1.0;
                }
            }
        });
        let experts: Vec<usize> = routes.experts().collect();
        let n = routes.gaussians();
        let mut frames = Frames {
            extents: Vec::with_capacity(3 * n),
            rotations: Vec::with_capacity(4 * n),
            shifts: Vec::with_capacity(3 * n),
            descriptors: facets.iter().flat_map(|(_, described)| described.map(T::from_f64)).collect(),
        };
        for (i, (&cell, &pixel)) in routes.source.iter().zip(routes.pixel.iter()).enumerate() {
            let Facet { axes, steps, footprint } = facets[cell as usize].0;
            let wider = stretch.map_or(1.0, |stretch| stretch[pixel as usize].to_f64());
            if patches.cell.of(cell as usize).len() == 1 && experts[cell as usize] == 1 {
                // A pixel's neighbors say little of the slope of its own surface; so the footprint parametrization
                // stays.
                frames.extents.extend([T::from_f64(footprint * wider); 3]);
                frames.rotations.extend([T::ONE, T::ZERO, T::ZERO, T::ZERO]);
                frames.shifts.extend([T::ZERO; 3]);
                continue;
            }
            let side = f64::from(1 << level(pixel)) * wider;
            let [along, across] = [steps[0] * side, steps[1] * side / experts[cell as usize] as f64];
            let rotation = DQuat::from_mat3(&axes).normalize();
            let shift = axes.y_axis * (steps[1] * wider * f64::from(patches.shift[i]));
            frames.extents.extend([along, across, THICKNESS * along.min(across)].map(T::from_f64));
            frames.rotations.extend([rotation.w, rotation.x, rotation.y, rotation.z].map(T::from_f64));
            frames.shifts.extend(shift.to_array().map(T::from_f64));
        }
        frames
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_autograd::Pool;
    use weaver_router::Cells;

    const SIZE: [usize; 2] = [16, 32];
    const FOCAL: f64 = 30.0;

    /// Points, footprints and colors of a plane n . p = 2, seen by a camera at the origin; red grows to the right.
    fn plane(normal: DVec3) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let [height, width] = SIZE;
        let (mut points, mut footprints, mut colors) = (vec![], vec![], vec![]);
        for p in 0..height * width {
            let (x, y) = ((p % width) as f64 + 0.5 - 16.0, (p / width) as f64 + 0.5 - 8.0);
            let ray = DVec3::new(x / FOCAL, y / FOCAL, 1.0);
            let point = ray * (2.0 / normal.dot(ray));
            points.extend(point.to_array());
            footprints.push(point.z / FOCAL);
            colors.extend([(p % width) as f64 / 32.0, 0.5, 0.5]);
        }
        (points, footprints, colors)
    }

    /// The frames of one cell of 4 x 4 pixels at row 4, column 8, with so many Gaussians.
    fn frames(normal: DVec3, gaussians: u8, angle: f32) -> (Frames<f64>, Vec<f64>) {
        let (points, footprints, colors) = plane(normal);
        let surface = Surface { points: &points, footprints: &footprints, colors: &colors, height: 16, width: 32 };
        let pool = Pool::new();
        let mut cells = Cells { level: pool.filled(512, 0), angle: pool.filled(512, 0.0) };
        let (mut expert, first) = (vec![0; 512], 4 * 32 + 8);
        (expert[first], cells.level[first], cells.angle[first]) = (gaussians, 2, angle);
        let routes = Routes::new(&expert, 3, &pool);
        let patches = Patches::new(&routes, Some(&cells), SIZE, &pool);
        let frames = surface.frames(&routes, &patches, Some(&cells), None);
        let band = |i: usize| patches.band.of(i).iter().map(|&p| surface.point(p as usize)).sum::<DVec3>();
        let means = (0..usize::from(gaussians)).flat_map(|i| (band(i) / patches.band.of(i).len() as f64).to_array());
        (frames, means.collect())
    }

    fn axes(frames: &Frames<f64>, i: usize) -> DMat3 {
        let q = &frames.rotations[4 * i..];
        DMat3::from_quat(DQuat::from_xyzw(q[1], q[2], q[3], q[0]))
    }

    #[test]
    fn a_gaussian_lies_flat_on_its_patch_and_is_as_large() {
        let slanted = DVec3::new(0.4, -0.2, 1.0).normalize();
        let (frames, _) = frames(slanted, 1, 0.0);
        let axes = axes(&frames, 0);
        assert!(axes.z_axis.dot(slanted).abs() > 0.9999, "{axes}");
        // Without an angle the bands are columns: along them is down, across is right.
        assert!(axes.x_axis.y > 0.9 && axes.y_axis.x > 0.8, "{axes}");
        // The step on the plane at the pixel between the cell's middle ones, by the derivative of the intersection of
        // its ray with the plane.
        let ray = DVec3::new((10.0 - 16.0) / FOCAL, (6.0 - 8.0) / FOCAL, 1.0);
        let point = |ray: DVec3| ray * (2.0 / slanted.dot(ray));
        let step = |d: DVec3| (point(ray + d / FOCAL) - point(ray - d / FOCAL)) / 2.0;
        let (down, right) = (step(DVec3::Y), step(DVec3::X));
        let across = right.reject_from_normalized(down.normalize()).length();
        let expected = [4.0 * down.length(), 4.0 * across];
        for (found, expected) in frames.extents.iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < 0.03, "{found}, not {expected}");
        }
        assert_eq!(frames.extents[2], 0.5 * frames.extents[0].min(frames.extents[1]));
        assert_eq!(frames.descriptors[..5], [0.0, 0.0, 1.0, 0.0, 0.0]);
        assert!(frames.descriptors[9] > 0.02 && frames.descriptors[8].abs() < 1e-9, "luma grows across alone");
    }

    #[test]
    fn gaussians_of_a_cell_share_it_in_bands() {
        let (frames, means) = frames(DVec3::Z, 2, 0.0);
        let right = means[3] - means[0];
        assert!((right - 2.0 * 2.0 / FOCAL).abs() < 1e-9, "two columns apart, not {right}");
        assert!((frames.extents[1] / frames.extents[0] - 0.5).abs() < 1e-9);
        assert!(frames.shifts.iter().all(|s| *s == 0.0));
    }

    #[test]
    fn the_only_gaussian_of_a_pixel_is_a_ball() {
        let slanted = DVec3::new(0.4, -0.2, 1.0).normalize();
        let (points, footprints, colors) = plane(slanted);
        let surface = Surface { points: &points, footprints: &footprints, colors: &colors, height: 16, width: 32 };
        let pool = Pool::new();
        let routes = Routes::new(&[1; 512], 3, &pool);
        let patches = Patches::new(&routes, None, SIZE, &pool);
        let frames = surface.frames(&routes, &patches, None, None);
        for (i, footprint) in footprints.iter().enumerate() {
            assert_eq!(frames.extents[3 * i..3 * i + 3], [*footprint; 3]);
            assert_eq!(frames.rotations[4 * i..4 * i + 4], [1.0, 0.0, 0.0, 0.0]);
        }
    }

    #[test]
    fn bands_without_pixels_are_set_apart_by_hand() {
        // Three bands across the diagonal of a pixel.
        let (points, footprints, colors) = plane(DVec3::Z);
        let surface = Surface { points: &points, footprints: &footprints, colors: &colors, height: 16, width: 32 };
        let pool = Pool::new();
        let mut expert = vec![0; 512];
        expert[40] = 3;
        let routes = Routes::new(&expert, 3, &pool);
        let patches = Patches::new(&routes, None, SIZE, &pool);
        let frames = surface.frames(&routes, &patches, None, None);
        let step = 2.0 / FOCAL / 3.0;
        for (i, expected) in [-step, 0.0, step].into_iter().enumerate() {
            assert!((frames.shifts[3 * i] - expected).abs() < 1e-6, "{:?}", frames.shifts);
        }
    }
}
