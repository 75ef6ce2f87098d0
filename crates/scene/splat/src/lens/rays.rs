//! The rays of the pixels of an image, and the size of the pixels.

use super::cones::Cones;
use crate::error::RasterError;
use crate::tiles::BLOCK;
use rayon::prelude::*;
use std::sync::Arc;
use weaver_geometry::Intrinsics;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::lens::{Lens, Projection};
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, Row};
use weaver_scene::{CameraSlices, Model};

/// Places of the cosine of the angle from the axis at which the size of pixels is known.
const KNOTS: usize = 257;
/// Range of the sizes of pixels, over that on the axis: the formula of a lens may tend to zero or to infinity.
const SIZES: [f64; 2] = [1e-3, 100.0];
/// Bytes of tables that a cache keeps.
const CACHE: usize = 1 << 28;

/// A lens with its image.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Key {
    lens: Lens,
    intrinsics: Intrinsics,
    width: usize,
    height: usize,
}

impl Key {
    /// The lens of cameras, those of the first view; `None` for pinholes, or without a view.
    fn of<T: Real>(cameras: &CameraSlices<'_, T>) -> Option<Self> {
        let Model::Lens(lens) = cameras.model else { return None };
        let [fx, fy, cx, cy] = cameras.intrinsics.first_chunk::<4>()?.map(|x| x.to_f64());
        let intrinsics = Intrinsics { fx, fy, cx, cy };
        Some(Self { lens, intrinsics, width: cameras.width, height: cameras.height })
    }
}

/// The rays of the pixels of an image.
#[derive(Debug)]
pub(crate) struct Rays<T> {
    key: Key,
    /// Blocks of 4 x 4 pixels in a row of blocks.
    pub across: usize,
    /// x, y and z of the directions of length 1 of the pixels of each block; 0 where nothing is seen.
    pub blocks: Vec<[Row<T>; 3]>,
    pub cones: Cones,
    /// True if the columns of the image are periodic.
    pub around: bool,
    /// Solid angle of a pixel at the cosines -1 to 1 of the angle from the axis, and its slope up to the next one.
    sizes: Vec<[T; 2]>,
}

impl<T: Real> Rays<T> {
    fn new(key: Key) -> Self {
        let projection = key.lens.projection();
        // Windows of 16 x 16 pixels may reach beyond the image.
        let [across, down] = [key.width, key.height].map(|side| side.next_multiple_of(LANES) / BLOCK);
        let directions: Vec<[DVec3; LANES]> = (0..across * down)
            .into_par_iter()
            .map(|block| std::array::from_fn(|lane| direction(&key, &projection, across, block, lane)))
            .collect();
        let number = |x: f64| T::from_f64(x);
        let row = |block: &[DVec3; LANES], axis: usize| Row(block.map(|ray| number(ray[axis])));
        let blocks = directions.iter().map(|block| [row(block, 0), row(block, 1), row(block, 2)]).collect();
        let sizes: Vec<f64> = (0..KNOTS).map(|i| pixel_size(&key, &projection, i)).collect();
        let slope = |i: usize| (sizes[(i + 1).min(KNOTS - 1)] - sizes[i]) * (KNOTS - 1) as f64 / 2.0;
        Self {
            key,
            across,
            blocks,
            cones: Cones::new(&directions, across),
            around: key.lens == Lens::Equirectangular,
            sizes: (0..KNOTS).map(|i| [number(sizes[i]), number(slope(i))]).collect(),
        }
    }

    /// Solid angle of a pixel at this cosine of the angle from the axis, and its derivative.
    #[inline]
    pub fn pixel_size(&self, cosine: T) -> [T; 2] {
        let at = ((cosine.to_f64() + 1.0) / 2.0 * (KNOTS - 1) as f64).clamp(0.0, (KNOTS - 1) as f64);
        // Of NaN the first.
        let i = at as usize;
        let [size, slope] = self.sizes[i];
        let past = cosine - T::from_f64(2.0 * i as f64 / (KNOTS - 1) as f64 - 1.0);
        [size + slope * past, slope]
    }

    /// True if they are the rays of these cameras.
    pub fn is_of(&self, cameras: &CameraSlices<'_, T>) -> bool {
        Key::of(cameras) == Some(self.key)
    }

    fn bytes(&self) -> usize {
        size_of_val(&*self.blocks) * 5 / 4
    }
}

/// The direction of a pixel of a block; 0 where nothing is seen.
fn direction(key: &Key, projection: &Projection, across: usize, block: usize, lane: usize) -> DVec3 {
    let (x, y) = (block % across * BLOCK + lane % BLOCK, block / across * BLOCK + lane / BLOCK);
    if x >= key.width || y >= key.height {
        return DVec3::ZERO;
    }
    let Intrinsics { fx, fy, cx, cy } = key.intrinsics;
    let at = DVec2::new((x as f64 + 0.5 - cx) / fx, (y as f64 + 0.5 - cy) / fy);
    projection.ray(at).unwrap_or(DVec3::ZERO)
}

/// Solid angle of a pixel at a knot: 1 over the determinant of the projection's derivative along the sphere.
fn pixel_size(key: &Key, projection: &Projection, knot: usize) -> f64 {
    let on_axis = 1.0 / (key.intrinsics.fx * key.intrinsics.fy);
    if key.lens == Lens::Equirectangular {
        return on_axis;
    }
    let cosine: f64 = 2.0 * knot as f64 / (KNOTS - 1) as f64 - 1.0;
    // Beyond the lens's domain as at its border.
    let (sin, cos) = cosine.acos().min(0.999 * projection.last_angle()).sin_cos();
    let along = DVec2::new(0.6, 0.8);
    let (direction, outward) = ((along * sin).extend(cos), (along * cos).extend(-sin));
    let [x, y] = projection.jacobian(direction).unwrap_or([DVec3::X, DVec3::Y]);
    let across = direction.cross(outward);
    let size = 1.0 / (x.dot(outward) * y.dot(across) - x.dot(across) * y.dot(outward)).abs();
    on_axis * size.clamp(SIZES[0], SIZES[1])
}

/// Tables of rays of the last cameras: it takes long to make one.
#[derive(Debug)]
pub(crate) struct RaysCache<T>(Vec<Arc<Rays<T>>>);

impl<T> Default for RaysCache<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T: Real> RaysCache<T> {
    /// The rays of cameras; `None` for pinholes.
    pub fn of(&mut self, cameras: &CameraSlices<'_, T>) -> Result<Option<Arc<Rays<T>>>, RasterError> {
        let Some(key) = Key::of(cameras) else { return Ok(None) };
        if cameras.intrinsics.chunks_exact(4).any(|other| other != &cameras.intrinsics[..4]) {
            let message = "views of one call through a lens have the same intrinsics, found several";
            return Err(RasterError::Arguments(message.into()));
        }
        let Intrinsics { fx, fy, cx, cy } = key.intrinsics;
        if !(fx > 0.0 && fy > 0.0 && [fx, fy, cx, cy].iter().all(|x| x.is_finite())) {
            return Err(RasterError::Arguments(format!(
                "intrinsics of a lens are finite and focal lengths above 0, found fx {fx} fy {fy} cx {cx} cy {cy}"
            )));
        }
        let rays = match self.0.iter().position(|rays| rays.key == key) {
            Some(at) => self.0.remove(at),
            None => Arc::new(Rays::new(key)),
        };
        self.0.insert(0, rays.clone());
        let mut bytes = 0;
        // The last one always stays.
        self.0.retain(|rays| {
            let kept = bytes < CACHE;
            bytes += rays.bytes();
            kept
        });
        Ok(Some(rays))
    }
}
