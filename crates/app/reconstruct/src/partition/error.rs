//! Errors of cutting a capture.

/// Why a capture cannot be cut.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BlockError {
    /// There are fewer points than blocks need.
    #[error("points: expected at least {needed}, {} for each of {blocks} blocks, found {found}", needed / blocks)]
    Points {
        /// Number of blocks.
        blocks: usize,
        /// The least number of points.
        needed: usize,
        /// The number of points.
        found: usize,
    },
    /// No photo to fit to sees enough of a region.
    #[error(
        "block {block} of {blocks}: expected photos of which a share of {share} of the points lies in the block, found none; fewer blocks, or a smaller share, leave some"
    )]
    Photos {
        /// Number of the block.
        block: usize,
        /// Number of blocks.
        blocks: usize,
        /// [`BlockOptions::share`](super::BlockOptions::share).
        share: String,
    },
}
