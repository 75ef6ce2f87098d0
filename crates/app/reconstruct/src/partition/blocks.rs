//! Photos and points of each block.

use super::{BlockError, Region, ground_axes, regions};
use weaver_geometry::Pose;

/// The points of a capture, and which photo sees which.
#[derive(Clone, Copy, Debug)]
pub struct Sights<'a> {
    /// Positions, world units.
    pub points: &'a [[f32; 3]],
    /// The photos.
    pub photos: &'a [Sight<'a>],
}

/// View of one photo.
#[derive(Clone, Copy, Debug)]
pub struct Sight<'a> {
    /// World to camera.
    pub pose: Pose,
    /// Indices of points.
    pub visible: &'a [u32],
    /// True if the photo is kept from the fit.
    pub held_out: bool,
}

/// Options of a cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockOptions {
    /// Number of blocks.
    pub count: usize,
    /// Share of a photo's visible points inside the block from which on the photo belongs to the block, from 0 to 1.
    pub share: f64,
}

/// A part of a capture.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// The block's own part of space.
    pub region: Region,
    /// Numbers of its photos, ascending.
    pub photos: Vec<usize>,
    /// Numbers of the points that its photos to fit to see, and of its own, ascending: points outside of the region are
    /// the frame.
    pub points: Vec<usize>,
    /// Number of the points that lie in the region.
    pub own: usize,
}

/// Cuts a capture into blocks: [`regions`] along the [`ground_axes`], and for each the photos with at least
/// [`BlockOptions::share`] of their visible points in it.
///
/// # Errors
/// When there are too few points, or a region is seen by no photo to fit to.
pub fn blocks(sights: &Sights, options: &BlockOptions) -> Result<Vec<Block>, BlockError> {
    let poses: Vec<Pose> = sights.photos.iter().map(|photo| photo.pose).collect();
    let regions = regions(sights.points, ground_axes(&poses), options.count)?;
    regions.into_iter().enumerate().map(|(number, region)| block(sights, options, number, region)).collect()
}

fn block(sights: &Sights, options: &BlockOptions, number: usize, region: Region) -> Result<Block, BlockError> {
    let own: Vec<bool> = sights.points.iter().map(|point| region.contains(*point)).collect();
    let belongs = |photo: &Sight| {
        let seen = photo.visible.iter().filter(|point| own[**point as usize]).count();
        seen > 0 && seen as f64 >= options.share * photo.visible.len() as f64
    };
    let photos: Vec<usize> = (0..sights.photos.len()).filter(|i| belongs(&sights.photos[*i])).collect();
    let mut taken = own.clone();
    let mut fitted = photos.iter().map(|i| &sights.photos[*i]).filter(|photo| !photo.held_out).peekable();
    if fitted.peek().is_none() {
        let share = options.share.to_string();
        return Err(BlockError::Photos { block: number, blocks: options.count, share });
    }
    fitted.flat_map(|photo| photo.visible).for_each(|point| taken[*point as usize] = true);
    let points = (0..taken.len()).filter(|i| taken[*i]).collect();
    Ok(Block { region, photos, points, own: own.iter().filter(|own| **own).count() })
}
