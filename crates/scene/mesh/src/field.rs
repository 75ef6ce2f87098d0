//! Truncated signed distances in blocks near surfaces.

use crate::blocks::{CELLS, Place, SIDE, cell};
use rayon::prelude::*;
use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;
use weaver_surfel::SurfelCamera;

/// Sides of a texture, texels.
pub(crate) const SIDES: std::ops::RangeInclusive<usize> = 16..=16_384;

/// The most blocks of a field, whose vertices 32 bits can number.
pub(crate) const MOST_BLOCKS: usize = 1 << 21;
/// Bytes of a block while a mesh is made of a field: distances and weights of cells, numbers of vertices, and vertices
/// and triangles of the surface, which crosses about half of the blocks.
const BLOCK_BYTES: u64 = 10_000;
/// Blocks farther from the origin than this, in blocks, have cells that 32 bits cannot number.
const FARTHEST: u32 = 1 << 27;
/// The weight of a distance of the whole truncation behind a surface.
const LEAST_TRUST: f64 = 1e-3;
/// Parts in which blocks are averaged.
const PARTS: usize = 32;

/// Why a field or a mesh cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// A size that makes no sense.
    #[error("{what}: expected meters above 0, found {found}")]
    Size {
        /// Name of the size.
        what: &'static str,
        /// Its value.
        found: f64,
    },
    /// A view whose images do not have its camera's size.
    #[error("view {view}: expected {expected} ranges, and no or as many normals, found {ranges} and {normals}")]
    View {
        /// Number of the view.
        view: usize,
        /// Pixels.
        expected: usize,
        /// Ranges.
        ranges: usize,
        /// Normals.
        normals: usize,
    },
    /// A photo whose pixels do not have its camera's size.
    #[error("photo {view}: expected {expected} pixels, and no mask or as large a one, found {pixels} and {masked}")]
    Photo {
        /// Number of the photo.
        view: usize,
        /// Pixels of its camera.
        expected: usize,
        /// Pixels.
        pixels: usize,
        /// Pixels of its mask.
        masked: usize,
    },
    /// A side of a texture that is too short or too long.
    #[error("texture: expected a side of {} to {} texels, found {found}", SIDES.start(), SIDES.end())]
    Side {
        /// Its length.
        found: usize,
    },
    /// A texture without room for its charts.
    #[error(
        "texture: expected room for {charts} charts, found {size} x {size} texels; fewer triangles have fewer charts"
    )]
    Charts {
        /// Texels of a side.
        size: usize,
        /// Number of charts.
        charts: usize,
    },
    /// More blocks than can be numbered.
    #[error("cells of {voxel} m: expected at most {MOST_BLOCKS} blocks of 8 x 8 x 8 cells, found more")]
    TooMany {
        /// Side of a cell, meters.
        voxel: f64,
    },
}

/// A moment in which a part of a field was made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FieldProgress {
    /// Parts that are done.
    pub done: usize,
    /// All parts: a view in which blocks are searched is one, and so is a 32nd of the blocks.
    pub of: usize,
    /// Bytes that the field and its mesh take at least, by the blocks that are known.
    pub bytes: u64,
}

/// A range image with its camera.
#[derive(Clone, Copy, Debug)]
pub struct RangeView<'a> {
    /// Lens and size.
    pub camera: &'a SurfelCamera,
    /// World to camera.
    pub pose: Pose,
    /// Distances `[H, W]`, meters; 0 where nothing is known, infinite where nothing is.
    pub range: &'a [f32],
    /// Normals in the camera's frame, of any length, `[H, W, 3]`; empty where unknown.
    pub normal: &'a [f32],
}

/// Means of truncated signed distances, positive before surfaces, in the blocks that lie within the truncation of a
/// range.
#[derive(Clone, Debug, Default)]
pub struct DistanceField {
    /// Side of a cell, meters.
    pub(crate) voxel: f64,
    /// Largest distance, meters.
    pub(crate) truncation: f64,
    /// Places of blocks, ascending.
    pub(crate) blocks: Vec<Place>,
    /// Distances and weights at the lower corners of cells, block by block.
    pub(crate) cells: Vec<[f32; 2]>,
}

impl DistanceField {
    /// Averages range images in cells of side `voxel`, with distances up to `truncation`, both in meters.
    ///
    /// At a cell's corner p, which a view sees at the range r, the distance is (r - |p|) |n.d|, for the normal n and
    /// the direction d: that to the plane and not along the ray. Space farther behind a surface than the truncation is
    /// left alone. Weights are |n.d|.
    ///
    /// # Errors
    /// [`MeshError`] where sizes make no sense or do not fit.
    pub fn new(views: &[RangeView<'_>], voxel: f64, truncation: f64) -> Result<Self, MeshError> {
        Self::watched(views, voxel, truncation, |_| Ok(()))
    }

    /// The same, and calls `observe` after every part. Blocks are known, view by view, before memory is taken for their
    /// cells.
    ///
    /// # Errors
    /// As [`new`](Self::new), and the first error of `observe`, which ends it.
    pub fn watched<E: From<MeshError>>(
        views: &[RangeView<'_>],
        voxel: f64,
        truncation: f64,
        mut observe: impl FnMut(FieldProgress) -> Result<(), E>,
    ) -> Result<Self, E> {
        for (what, found) in [("cells", voxel), ("truncation", truncation)] {
            if !(found > 0.0 && found.is_finite()) {
                return Err(MeshError::Size { what, found }.into());
            }
        }
        for (i, view) in views.iter().enumerate() {
            let (expected, ranges, normals) = (view.camera.pixels(), view.range.len(), view.normal.len() / 3);
            if ranges != expected || ![0, expected].contains(&normals) {
                return Err(MeshError::View { view: i, expected, ranges, normals }.into());
            }
        }
        let mut blocks: Vec<Place> = Vec::new();
        let of = views.len() + PARTS;
        for (i, view) in views.iter().enumerate() {
            let mut own = near(view, voxel, truncation);
            own.par_sort_unstable();
            own.dedup();
            let far = own.par_iter().any(|place| place.iter().any(|x| x.unsigned_abs() > FARTHEST));
            blocks.extend(own);
            blocks.par_sort_unstable();
            blocks.dedup();
            if far || blocks.len() > MOST_BLOCKS {
                return Err(MeshError::TooMany { voxel }.into());
            }
            observe(FieldProgress { done: i + 1, of, bytes: BLOCK_BYTES * blocks.len() as u64 })?;
        }
        let bytes = BLOCK_BYTES * blocks.len() as u64;
        let mut cells = vec![[0.0; 2]; blocks.len() * CELLS];
        let part = blocks.len().div_ceil(PARTS).max(1);
        for (i, (cells, blocks)) in cells.chunks_mut(part * CELLS).zip(blocks.chunks(part)).enumerate() {
            cells
                .par_chunks_mut(CELLS)
                .zip(blocks)
                .for_each(|(cells, block)| average(views, *block, voxel, truncation, cells));
            observe(FieldProgress { done: views.len() + i + 1, of, bytes })?;
        }
        Ok(Self { voxel, truncation, blocks, cells })
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.blocks.len()
    }
}

/// Averages the distances of a block's cells.
fn average(views: &[RangeView<'_>], block: Place, voxel: f64, truncation: f64, cells: &mut [[f32; 2]]) {
    for (at, mean) in cells.iter_mut().enumerate() {
        let corner = DVec3::from_array(cell(block, at).map(f64::from)) * voxel;
        let (mut sum, mut weights) = (0.0, 0.0);
        for view in views {
            if let Some([distance, weight]) = distance(view, corner, truncation) {
                let weight = weight * trust(distance, voxel, truncation);
                sum += weight * distance;
                weights += weight;
            }
        }
        if weights > 0.0 {
            *mean = [(sum / weights) as f32, weights as f32];
        }
    }
}

/// The weight of a distance: behind a surface it is guessed, and yields to views that see that place, so that a wall
/// thinner than the truncation keeps both sides. 1 down to a cell behind, then falling to nearly nothing.
fn trust(distance: f64, voxel: f64, truncation: f64) -> f64 {
    let depth = (-distance - voxel) / (truncation - voxel).max(voxel);
    (1.0 - depth.clamp(0.0, 1.0)).powi(4).max(LEAST_TRUST)
}

/// The blocks that rays go through within the truncation of their ranges.
fn near(view: &RangeView<'_>, voxel: f64, truncation: f64) -> Vec<Place> {
    let to_world = view.pose.inverse();
    let (width, side) = (view.camera.width, voxel * f64::from(SIDE));
    let steps = (2.0 * truncation / (0.5 * side)).ceil().max(1.0);
    let rows = view.range.par_chunks(width).enumerate().map(|(row, ranges)| {
        let mut own = Vec::new();
        for (column, range) in ranges.iter().enumerate().filter(|(_, r)| **r > 0.0 && r.is_finite()) {
            let ray = view.camera.pixel_ray(column, row);
            for i in 0..=steps as usize {
                let r = f64::from(*range) + truncation * (2.0 * i as f64 / steps - 1.0);
                let p = to_world.apply(ray * r.max(0.0)) / side;
                // Cells on both sides of a face: half a cell of a block around.
                for dz in [-0.1, 0.1] {
                    for dy in [-0.1, 0.1] {
                        for dx in [-0.1, 0.1] {
                            own.push((p + DVec3::new(dx, dy, dz)).floor().to_array().map(|x| x as i32));
                        }
                    }
                }
            }
            own.dedup();
        }
        own.sort_unstable();
        own.dedup();
        own
    });
    rows.collect::<Vec<_>>().concat()
}

/// The distance of a point from the surface that a view sees there, and its weight.
pub(crate) fn distance(view: &RangeView<'_>, point: DVec3, truncation: f64) -> Option<[f64; 2]> {
    let p = view.pose.apply(point);
    let at = view.camera.project(p);
    let (width, height) = (view.camera.width, view.camera.height);
    let column = match view.camera.period() {
        Some(_) => at.x.floor().rem_euclid(width as f64),
        None => at.x.floor(),
    };
    if !(column >= 0.0 && column < width as f64 && at.y >= 0.0 && at.y < height as f64) {
        return None;
    }
    let pixel = at.y as usize * width + column as usize;
    let range = f64::from(view.range[pixel]);
    if range <= 0.0 || range.is_nan() {
        return None;
    }
    let reach = p.length();
    let normal = view.normal.get(3 * pixel..3 * pixel + 3);
    // Along the plane of the pixel, whose center is not where the point is seen.
    let (along, facing) = match normal.map(|n| DVec3::new(n[0].into(), n[1].into(), n[2].into())) {
        Some(n) if n.length_squared() > 0.0 => {
            let n = n.normalize();
            let ray = view.camera.pixel_ray(column as usize, at.y as usize);
            ((p - ray * range).dot(-n * ray.dot(n).signum()), ray.dot(n).abs())
        }
        _ => (range - reach, 1.0),
    };
    (along > -truncation && (range - reach).abs() < 4.0 * truncation || along >= truncation && reach < range)
        .then(|| [along.min(truncation), facing.max(0.05)])
}
