//! Memory of the rasteriser, kept between calls.

use crate::project::Splat;
use crate::scene::{Extent, RasterSettings};
use crate::tiles::TileLists;
use weaver_kernels::Real;

/// What forward leaves for backward, and room to work in. It only grows: calls of sizes seen before allocate nothing.
#[derive(Debug)]
pub struct Workspace<T> {
    /// The sizes and settings of the last forward.
    pub(crate) drawn: Option<(Extent, RasterSettings)>,
    /// `[V, N]`; what is not drawn holds leftovers.
    pub(crate) splats: Vec<Splat<T>>,
    /// Sort keys, `[V, N]`.
    pub(crate) keys: Vec<u64>,
    /// Running sums of how many tiles each splat touches, `[V * N + 1]`.
    pub(crate) offsets: Vec<u32>,
    /// Which splats each tile looks at.
    pub(crate) lists: TileLists,
    /// Transmittance, red, green, blue, depth of each tile, `[V * tiles, 5, S, S]`.
    pub(crate) planes: Vec<T>,
    /// 1 + the last list index seen at each pixel, `[V * tiles, S, S]`.
    pub(crate) last: Vec<u32>,
    /// Sums of each list entry, `[entries, 12]`.
    pub(crate) moments: Vec<T>,
    /// Background gradients of the tiles, `[V * tiles, 3]`.
    pub(crate) background_sums: Vec<T>,
    /// Camera gradients of chunks of Gaussians, `[chunks, V, 19]`.
    pub(crate) camera_sums: Vec<T>,
}

impl<T: Real> Workspace<T> {
    /// An empty workspace.
    pub fn new() -> Self {
        Self {
            drawn: None,
            splats: Vec::new(),
            keys: Vec::new(),
            offsets: Vec::new(),
            lists: TileLists::default(),
            planes: Vec::new(),
            last: Vec::new(),
            moments: Vec::new(),
            background_sums: Vec::new(),
            camera_sums: Vec::new(),
        }
    }
}

impl<T: Real> Default for Workspace<T> {
    fn default() -> Self {
        Self::new()
    }
}
