//! What every kind of capture comes down to before its photos are read.

use weaver_geometry::glam::DVec3;
use weaver_scene::Frame;

/// One photo and its camera, at the photo's own size.
#[derive(Clone, Debug)]
pub(super) struct Photo {
    /// Name, image file, camera, time and number.
    pub frame: Frame,
    pub held_out: bool,
    /// Indices of the points it observes, ascending, each once.
    pub track: Vec<u32>,
}

/// The photos and points of a capture.
#[derive(Clone, Debug)]
pub(super) struct Photos {
    pub photos: Vec<Photo>,
    pub points: Vec<DVec3>,
    /// sRGB colors of the points, as many.
    pub colors: Vec<[u8; 3]>,
    /// Whether the capture itself says which photos are held out.
    pub split: bool,
}

impl Photos {
    /// Photos of which only names and cameras are known.
    pub fn without_points(frames: Vec<Frame>) -> Self {
        let photos = frames.into_iter().map(|frame| Photo { frame, held_out: false, track: Vec::new() }).collect();
        Self { photos, points: Vec::new(), colors: Vec::new(), split: false }
    }
}
