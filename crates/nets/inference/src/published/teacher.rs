//! Cameras and depth by a published checkpoint, for others to learn from.

use super::{Opened, estimate};
use crate::{Error, planar};
use std::path::Path;
use weaver_autograd::{Params, Tape};
use weaver_geometry::Camera;
use weaver_io::Image;
use weaver_nn::Context;
use weaver_scene::{CameraSlices, Model};
use weaver_vggt::Vggt;

/// Cameras and depth of some photos, as a network sees them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Geometry {
    /// The cameras, in the frame and the units of the network's choice.
    pub cameras: Vec<Camera>,
    /// Depth along the optical axis `[V, H, W]`, in these units.
    pub depth: Vec<f32>,
    /// Confidence of the depth `[V, H, W]`, at least 1.
    pub confidence: Vec<f32>,
}

impl Geometry {
    /// Runs a network on photos `[V, 3, H, W]` of `size` (H, W), all together; the depth head sees one after the other.
    pub(super) fn of(
        vggt: &Vggt,
        params: &Params<f32>,
        planes: &[f32],
        size: [usize; 2],
        watcher: impl Fn(&str) + Send + 'static,
    ) -> Result<Self, Error> {
        let [height, width] = size;
        let views = planes.len() / (3 * height * width).max(1);
        let tape = Tape::<f32>::new();
        tape.watch(watcher);
        let cx = Context::new(&tape, params);
        let mut depth = Vec::with_capacity(views * height * width);
        let mut confidence = Vec::with_capacity(views * height * width);
        let cameras = tape.without_gradient(|| {
            let encoded = vggt.encode(cx, tape.constant(planes, [1, views, 3, height, width]));
            tape.pool().trim::<f32>();
            tape.for_each(0..views, |view| {
                let maps = vggt.depth(cx, &encoded, 0, [view, 1], size);
                depth.extend_from_slice(&maps.depth.value());
                confidence.extend_from_slice(&maps.confidence.value());
            });
            let cameras = encoded.scene_cameras(0);
            let (viewmats, intrinsics) = (&cameras.viewmats.value(), &cameras.intrinsics.value());
            CameraSlices { viewmats, intrinsics, background: &[], width, height, model: Model::Pinhole }.to_cameras()
        });
        if depth.iter().chain(&confidence).any(|x| !x.is_finite()) {
            return Err(Error::Numeric { what: "the depth".into() });
        }
        Ok(Self { cameras, depth, confidence })
    }
}

/// A published checkpoint that gives cameras and depth of photos: SplatWeaver's or VGGT's, whose Gaussian head is not
/// used.
#[derive(Debug)]
pub struct Teacher {
    opened: Opened,
}

impl Teacher {
    /// Opens a checkpoint: a safetensors file, an index of several, or a folder.
    ///
    /// # Errors
    /// When it cannot be read or is a checkpoint of another model.
    pub fn open(weights: &Path) -> Result<Self, Error> {
        Ok(Self { opened: Opened::new(weights, false)? })
    }

    /// The checksum of the weights.
    pub fn checksum(&self) -> String {
        self.opened.weights().checksum()
    }

    /// The size (H, W) nearest to the checkpoint's own of photos with the shape of `like` (H, W): the longer side is
    /// the longer of its own, the other follows in whole patches.
    pub fn size(&self, like: [usize; 2]) -> [usize; 2] {
        let config = &self.opened.config;
        let (long, patch) = (config.height.max(config.width), config.patch);
        let longer = like[0].max(like[1]).max(1);
        like.map(|side| ((long as f64 * side as f64 / (longer * patch) as f64).round() as usize).max(1) * patch)
    }

    /// Cameras and depth of photos of one size, which are whole patches, all in one pass.
    ///
    /// # Errors
    /// When memory does not suffice, the weights do not fit, or the results are not finite.
    pub fn teach(&self, photos: &[Image]) -> Result<Geometry, Error> {
        let Some(first) = photos.first() else { return Ok(Geometry::default()) };
        let size = [first.height, first.width];
        estimate::check(estimate::bytes(&self.opened, photos.len(), size), weaver_io::available_memory(), false)?;
        let (network, params) = self.opened.load(false)?;
        let planes = planar(photos);
        Geometry::of(network.vggt(), &params, &planes, size, |_| {})
    }
}
