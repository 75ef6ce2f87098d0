//! Methods of compression behind one trait, and the table of them.

use crate::methods::{C3dgs, Format, Half, LightGaussian, Lite, MesonGs, SpeedySplat, Zstd};
use crate::{CompressError, Pictures};
use std::fmt::Debug;
use weaver_io::SCENE_FORMATS;
use weaver_scene::{Gaussians, Photo};

/// A scene to compress, and what a method may learn from.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    /// The scene.
    pub gaussians: &'a Gaussians,
    /// Cameras to measure importance and steps by, and to train with. Pictures that judge are of other cameras.
    pub pictures: Pictures<'a>,
    /// Photos to train with; without any, pictures of the scene itself.
    pub photos: &'a [Photo],
    /// Training steps in place of 5000 in a method's paper; other numbers of steps in proportion. Nothing is trained at 0.
    pub steps: usize,
    /// Seed of everything that is drawn at random.
    pub seed: u64,
}

/// A way to make a scene fewer bytes, with its constants.
///
/// ```
/// use weaver_compress::{METHODS, Pictures, Task};
/// use weaver_scene::{Gaussians, orbit};
///
/// let gaussians = Gaussians {
///     means: vec![[0.0, 0.0, 2.0]],
///     log_scales: vec![[-1.0, -1.5, -2.0]],
///     quats: vec![[1.0, 0.0, 0.0, 0.0]],
///     opacity_logits: vec![0.5],
///     sh: vec![0.1, 0.2, 0.3],
///     degree: 0,
/// };
/// let cameras = orbit(&gaussians, 3, [32, 32]).unwrap();
/// let pictures = Pictures { cameras: &cameras, background: [1.0; 3], settings: Default::default() };
/// let task = Task { gaussians: &gaussians, pictures, photos: &[], steps: 0, seed: 0 };
/// let family = METHODS.iter().find(|family| family.name == "half").unwrap();
/// let half = &(family.points)()[0];
/// let bytes = half.method.encode(&Task { ..task })?;
/// assert_eq!(half.method.decode(&bytes)?.len(), 1);
/// # Ok::<(), weaver_compress::CompressError>(())
/// ```
pub trait Method: Debug {
    /// The bytes of a scene.
    ///
    /// # Errors
    /// A scene that cannot be encoded, drawn or trained.
    fn encode(&self, task: &Task<'_>) -> Result<Vec<u8>, CompressError>;

    /// The scene of such bytes, from them alone.
    ///
    /// # Errors
    /// Bytes of something else, or that are missing or changed.
    fn decode(&self, bytes: &[u8]) -> Result<Gaussians, CompressError>;
}

/// A method with certain constants: a point of its curve of quality by bytes.
#[derive(Debug)]
pub struct Point {
    /// The constants, in short; empty where there is but one choice.
    pub setting: String,
    /// The method.
    pub method: Box<dyn Method>,
}

/// A method with all constants that it is compared at.
#[derive(Clone, Copy, Debug)]
pub struct Family {
    /// Its name.
    pub name: &'static str,
    /// Its parts.
    pub about: &'static str,
    /// Its points, the best quality first.
    pub points: fn() -> Vec<Point>,
}

/// The methods beside the [formats](formats) of files. A further one is a file in `methods` and a row here.
pub const METHODS: [Family; 8] = [
    Family { name: "lite", about: "measured steps, mixed contexts, range coding (.wsz)", points: Lite::points },
    Family {
        name: "lightgaussian",
        about: "pruned by weight and volume, harmonics of degree 2 distilled, codebook of harmonics (Fan et al., 2023)",
        points: LightGaussian::points,
    },
    Family {
        name: "mesongs",
        about: "pruned, octree, RAHT in 8 bits, codebook of harmonics (Xie et al., 2024)",
        points: MesonGs::points,
    },
    Family {
        name: "c3dgs",
        about: "codebooks of colors and shapes weighted by sensitivity, trained (Niedermayr et al., 2024)",
        points: C3dgs::points,
    },
    Family {
        name: "speedysplat",
        about: "pruned by squared gradients of pixels, trained; no coding (Hanson et al., 2024)",
        points: SpeedySplat::points,
    },
    Family { name: "zstd", about: "control: PLY packed by zstd", points: Zstd::points },
    Family { name: "half", about: "control: the more important half of the Gaussians", points: Half::important },
    Family { name: "half-random", about: "control: half of the Gaussians at random", points: Half::random },
];

/// The formats of single files as methods, by name.
pub fn formats() -> Vec<(&'static str, Point)> {
    let point = |format| Point { setting: String::new(), method: Box::new(Format { format }) };
    let written = SCENE_FORMATS.into_iter().filter(|format| format.writes_one_file());
    written.map(|format| (format.name, point(format))).collect()
}
