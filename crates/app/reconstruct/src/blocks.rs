//! A capture cut into blocks that are fitted apart, and their fits joined.
//!
//! | file | content |
//! |---|---|
//! | `block-NN/block.json` | [`BlockFile`]: region, sizes and memory of the block |
//! | `block-NN/capture/` | the block as an ordinary capture: `transforms.json`, `sparse/0`; the photos stay where they are |
//! | `block-NN/fit/` | its fit |

mod merge;
mod split;

pub use merge::{Merged, merge};
pub use split::{BlockCount, Split, SplitOptions, split};

use crate::partition::Region;
use serde::{Deserialize, Serialize};

/// A block of a capture, `block.json`.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct BlockFile {
    /// Checksum of the regions of all blocks: blocks of one split have the same.
    pub split: String,
    /// Number of the block, from 0.
    pub number: usize,
    /// Number of blocks.
    pub blocks: usize,
    /// Photos to fit to.
    pub photos: usize,
    /// Photos held out.
    pub held_out: usize,
    /// Points.
    pub points: usize,
    /// Points in the block's region.
    pub own_points: usize,
    /// Gaussians that its fit is meant to have.
    pub gaussians: usize,
    /// Bytes that its fit takes ([`Plan::total`](crate::Plan::total)).
    pub memory: u64,
    /// The region whose Gaussians are kept.
    #[serde(with = "cuts")]
    pub region: Region,
}

impl BlockFile {
    /// Name of the file.
    pub const NAME: &str = "block.json";
    /// Folder of the capture beside it.
    pub const CAPTURE: &str = "capture";
    /// Folder of the fit beside it.
    pub const FIT: &str = "fit";

    /// Name of the block's folder.
    pub fn folder(&self) -> String {
        Self::folder_of(self.number)
    }

    fn folder_of(number: usize) -> String {
        format!("block-{number:02}")
    }
}

/// A region in a file: the normal, the offset and the side of each plane.
mod cuts {
    use crate::partition::{Cut, Region};
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    #[derive(Deserialize, Serialize)]
    struct Plane {
        normal: [f64; 3],
        offset: f64,
        above: bool,
    }

    pub fn serialize<S: Serializer>(region: &Region, to: S) -> Result<S::Ok, S::Error> {
        let plane = |&Cut { normal, offset, above }: &Cut| Plane { normal, offset, above };
        region.cuts.iter().map(plane).collect::<Vec<_>>().serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Region, D::Error> {
        let planes = Vec::<Plane>::deserialize(from)?;
        let cut = |Plane { normal, offset, above }: Plane| Cut { normal, offset, above };
        Ok(Region { cuts: planes.into_iter().map(cut).collect() })
    }
}
