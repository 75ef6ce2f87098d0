//! A capture too large for one fit, cut into blocks that are fitted apart and joined. Geometry alone: no photos, no
//! files.
//!
//! ```
//! use weaver_reconstruct::partition::{BlockOptions, Sight, Sights, blocks};
//! use weaver_geometry::{Pose, glam::DVec3};
//!
//! // A wall of points along x, and a camera before each stretch of it that sees ten of them.
//! let points: Vec<[f32; 3]> = (0..60).map(|i| [i as f32, 0.0, 5.0]).collect();
//! let visible: Vec<Vec<u32>> = (0..6).map(|i| (10 * i..10 * i + 10).collect()).collect();
//! let pose = |i: usize| Pose { translation: DVec3::new(-5.0 - 10.0 * i as f64, 0.0, 0.0), ..Pose::IDENTITY };
//! let photos: Vec<Sight> =
//!     visible.iter().enumerate().map(|(i, visible)| Sight { pose: pose(i), visible, held_out: false }).collect();
//! let sights = Sights { points: &points, photos: &photos };
//!
//! let found = blocks(&sights, &BlockOptions { count: 3, share: 0.05 })?;
//! assert_eq!(found[0].photos, [0, 1]);
//! assert!(found.iter().all(|block| block.own == 20));
//! // Each place belongs to one block.
//! assert_eq!(found.iter().filter(|block| block.region.contains([17.3, 4.0, -2.0])).count(), 1);
//! # Ok::<(), weaver_reconstruct::partition::BlockError>(())
//! ```
//!
//! 1. [`regions`] cuts space by planes that stand on the ground, so that every region has as many points as any other.
//! 2. [`blocks`] gives each region the photos that see enough of it, and the points that these photos see.
//! 3. Each block is fitted on its own, anywhere.
//! 4. [`color_maps`] matches the colors of fits with corrected photo colors.
//! 5. [`merged`] keeps of each fit the Gaussians whose centers lie in its region.
//!
//! Regions do not overlap and leave no gap: each center belongs to exactly one.

mod blocks;
mod colors;
mod error;
mod ground;
mod merge;
mod region;

pub use blocks::{Block, BlockOptions, Sight, Sights, blocks};
pub use colors::{ColorMap, color_maps};
pub use error::BlockError;
pub use ground::ground_axes;
pub use merge::merged;
pub use region::{Cut, Region, regions};
