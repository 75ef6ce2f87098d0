//! Point clouds.

/// A colored point cloud. `N` is the number of points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Positions in world units, `[N, 3]`.
    pub positions: Vec<[f32; 3]>,
    /// sRGB colors, `[N, 3]`.
    pub colors: Vec<[u8; 3]>,
}

impl PointCloud {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// True if there are no points.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }
}
