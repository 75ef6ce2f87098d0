//! Cameras of photos whose distortion is undone.

use crate::{Camera, Distortion};
use glam::DVec2;

/// Largest factor by which a focal length grows, so that no border is blank.
const LONGEST: f64 = 4.0;
/// Largest factor by which it shrinks, to show all of a photo: below it the middle would lose too much to the borders.
const SHORTEST: f64 = 0.5;
/// Halvings of the interval of such factors.
const HALVINGS: usize = 40;
/// Places of each side of a photo that must come from within it.
const PLACES: usize = 64;

/// Conversion of a photo to one of a lens without distortion: as large, from the same place, with the same principal
/// point, and with the smallest focal length, at least half of the distorted one, at which nothing of it is blank.
///
/// The factor on the focal length does not depend on the photo's size: it is the same for a photo that was shrunk
/// before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Undistortion {
    /// The camera with distortion.
    pub from: Camera,
    /// Its distortion.
    pub distortion: Distortion,
    /// The camera without.
    pub to: Camera,
    /// Distance from the axis up to which the distortion is known.
    reach: f64,
}

impl Undistortion {
    /// The distortion of a camera, undone; `None` where blank borders remain even at four times the focal length.
    pub fn new(from: Camera, distortion: Distortion) -> Option<Self> {
        let reach = distortion.reach();
        let with = |zoom: f64| {
            let mut to = from;
            (to.intrinsics.fx, to.intrinsics.fy) = (zoom * from.intrinsics.fx, zoom * from.intrinsics.fy);
            Self { from, distortion, to, reach }
        };
        if with(SHORTEST).is_full() {
            return Some(with(SHORTEST));
        }
        let (mut short, mut long) = (SHORTEST, LONGEST);
        for _ in 0..HALVINGS {
            let middle = (short * long).sqrt();
            *(if with(middle).is_full() { &mut long } else { &mut short }) = middle;
        }
        Some(with(long)).filter(Self::is_full)
    }

    /// True if all of the second photo's border comes from within the first.
    fn is_full(&self) -> bool {
        let size = DVec2::new(self.from.width as f64, self.from.height as f64);
        let along = (0..=PLACES).map(|i| i as f64 / PLACES as f64);
        let mut border =
            along.flat_map(|t| [DVec2::new(t, 0.0), DVec2::new(t, 1.0), DVec2::new(0.0, t), DVec2::new(1.0, t)]);
        let within = |at: DVec2| {
            let seen = self.distorted(at * size);
            seen.cmpge(DVec2::ZERO).all()
                && seen.cmple(size).all()
                && self.to.intrinsics.unproject(at * size, 1.0).truncate().length() <= self.reach
        };
        border.all(within)
    }

    /// The pixel of the lens with distortion for a pixel of the lens without.
    pub fn distorted(&self, pixel: DVec2) -> DVec2 {
        let at = self.to.intrinsics.unproject(pixel, 1.0).truncate();
        self.from.intrinsics.project(self.distortion.distort(at).extend(1.0))
    }

    /// The pixel of the lens without distortion for a pixel of the lens with it; `None` where the latter sees nothing.
    pub fn undistorted(&self, pixel: DVec2) -> Option<DVec2> {
        let seen = self.from.intrinsics.unproject(pixel, 1.0).truncate();
        Some(self.to.intrinsics.project(self.distortion.undistort(seen)?.extend(1.0)))
    }
}
