//! Memory of the rasterizer, kept between calls.

use crate::cover::Chunk;
use crate::lists::Lists;
use crate::scene::{Extent, RasterError, RasterSettings};
use crate::splat::Splat;
use crate::window::Plane;
use std::sync::atomic::AtomicU64;
use std::time::Duration;
use weaver_kernels::lanes::Row;
use weaver_kernels::{Real, pages};

/// What forward leaves for backward, and room to work in. It only grows: calls of sizes seen before allocate nothing.
#[derive(Debug)]
pub struct Workspace<T> {
    /// The sizes and settings of the last forward.
    pub(crate) drawn: Option<(Extent, RasterSettings)>,
    /// `[V, N]`; what is not drawn holds leftovers.
    pub(crate) splats: Vec<Splat<T>>,
    /// The tiles of the splats, `[V, chunks]`.
    pub(crate) chunks: Vec<Chunk>,
    /// Keys of Gaussians by depth, and sorted, `[V, N]` each.
    pub(crate) keys: [Vec<AtomicU64>; 2],
    /// Counts of digits.
    pub(crate) counts: Vec<u32>,
    /// Which splats each tile looks at.
    pub(crate) lists: Lists,
    /// What drawing left in each window, `[V * tiles * windows, planes]`.
    pub(crate) planes: Vec<Plane<T>>,
    /// Sums of each list entry.
    pub(crate) moments: Vec<Row<T>>,
    /// Sums of features of each list entry, `[entries, C]`.
    pub(crate) feature_sums: Vec<T>,
    /// Background gradients of the tiles, `[V * tiles, 3]`.
    pub(crate) background_sums: Vec<[T; 3]>,
    /// Camera gradients of chunks of Gaussians.
    pub(crate) camera_sums: Vec<Row<T>>,
    pub(crate) stages: Stages,
}

/// How long the stages of the last calls took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stages {
    /// From Gaussians to splats, and which tiles they touch.
    pub project: Duration,
    /// Sorting by depth, and dealing to tiles.
    pub bin: Duration,
    /// Blending, and putting images together.
    pub composite: Duration,
    /// All of backward.
    pub backward: Duration,
}

impl<T: Real> Workspace<T> {
    /// An empty workspace.
    pub fn new() -> Self {
        Self {
            drawn: None,
            splats: Vec::new(),
            chunks: Vec::new(),
            keys: [Vec::new(), Vec::new()],
            counts: Vec::new(),
            lists: Lists::default(),
            planes: Vec::new(),
            moments: Vec::new(),
            feature_sums: Vec::new(),
            background_sums: Vec::new(),
            camera_sums: Vec::new(),
            stages: Stages::default(),
        }
    }

    /// The sizes and settings of the last forward.
    pub(crate) fn last(&self) -> Result<(Extent, RasterSettings), RasterError> {
        self.drawn.ok_or_else(|| RasterError::new("nothing was drawn with this workspace"))
    }

    /// How long the last forward and the last backward took.
    pub fn stages(&self) -> Stages {
        self.stages
    }
}

impl<T: Real> Default for Workspace<T> {
    fn default() -> Self {
        Self::new()
    }
}

/// A vector grown to at least `len` elements, and its first `len`.
pub(crate) fn grown<U: Default>(values: &mut Vec<U>, len: usize) -> &mut [U] {
    if values.len() < len {
        values.reserve_exact(len - values.len());
        // Most of it will be read in no order.
        pages::prefer_huge(values.spare_capacity_mut());
        values.resize_with(len, U::default);
    }
    &mut values[..len]
}
