//! The shaders' data of a view: the `View` of `shaders/view.wgsl`, word by word.

use weaver_scene::{CameraSlices, Color};
use weaver_splat::{Extent, RasterSettings, Region, View};

/// Pixels per side of a tile.
pub(crate) const SIDE: usize = 16;
/// Words of a view.
const WORDS: usize = 48;

/// The tiles of 16 pixels that meet a region, numbered in the whole image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Grid {
    pub first: [usize; 2],
    pub count: [usize; 2],
}

impl Grid {
    pub fn of(region: &Region) -> Self {
        let first = [region.x / SIDE, region.y / SIDE];
        let end = [(region.x + region.width).div_ceil(SIDE), (region.y + region.height).div_ceil(SIDE)];
        Self { first, count: [end[0] - first[0], end[1] - first[1]] }
    }

    pub fn tiles(&self) -> usize {
        self.count[0] * self.count[1]
    }
}

/// The Gaussians that a pass sees, and the use of their gradients.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Share {
    pub first: usize,
    pub count: usize,
    /// True if gradients are added to the earlier views'.
    pub add: bool,
    pub statistics: Option<Band>,
}

/// Place of a drawing among the bands of its view.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Band {
    pub first: bool,
    pub last: bool,
}

/// The words of a view; `region` is the part of it that is drawn.
pub(crate) fn view_words(
    cameras: &CameraSlices<'_, f32>,
    v: usize,
    settings: &RasterSettings,
    color: &Color<'_, f32>,
    extent: &Extent,
    region: &Region,
) -> [u32; WORDS] {
    let View { axes, shift, center, focal, principal, low, high, .. } = View::of(cameras, v);
    let background = cameras.background_of(v);
    let mut words = [0; WORDS];
    let mut at = 0;
    let mut put = |numbers: &[f32]| {
        for (word, number) in words[at..].iter_mut().zip(numbers) {
            *word = number.to_bits();
        }
        at += numbers.len();
    };
    for i in 0..3 {
        put(&[axes[i][0], axes[i][1], axes[i][2], shift[i]]);
    }
    put(&center);
    put(&[finite(settings.near)]);
    put(&focal);
    put(&principal);
    put(&low);
    put(&high);
    put(&background);
    put(&[finite(settings.far), settings.eps2d as f32, settings.alpha_max as f32]);
    put(&[settings.radius_clip.map_or(0.0, finite)]);
    let grid = Grid::of(region);
    let terms = if matches!(color, Color::Sh { .. }) { extent.color_len / 3 } else { 0 };
    let sizes = [region.x, region.y, region.width, region.height, grid.first[0], grid.first[1], grid.count[0]];
    words[31] = u32::from(settings.antialiased);
    for (word, size) in words[32..].iter_mut().zip(sizes.into_iter().chain([grid.count[1], 0, 0])) {
        *word = size as u32;
    }
    for (word, size) in words[42..].iter_mut().zip([extent.gaussians, terms, extent.color_len]) {
        *word = size as u32;
    }
    words
}

/// The words with a share of the Gaussians.
pub(crate) fn with_share(mut words: [u32; WORDS], share: Share) -> [u32; WORDS] {
    words[40..42].copy_from_slice(&[share.first as u32, share.count as u32]);
    let statistics = share.statistics.map_or(0, |band| 1 | u32::from(band.first) << 1 | u32::from(band.last) << 2);
    words[45..47].copy_from_slice(&[u32::from(share.add), statistics]);
    words
}

/// The words with the room there is for entries.
pub(crate) fn with_capacity(mut words: [u32; WORDS], entries: usize) -> [u32; WORDS] {
    words[47] = entries as u32;
    words
}

/// The nearest number that shaders may meet.
fn finite(x: f64) -> f32 {
    (x as f32).clamp(f32::MIN, f32::MAX)
}
