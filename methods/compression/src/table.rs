//! The table of methods.

use crate::method::Point;
use crate::methods::{C3dgs, Format, HacLite, Half, LightGaussian, Lite, MesonGs, SpeedySplat, Zstd};
use weaver_io::SCENE_FORMATS;

/// A method with all its compared constants.
#[derive(Clone, Copy, Debug)]
pub struct Family {
    /// Its name.
    pub name: &'static str,
    /// Its parts.
    pub about: &'static str,
    /// Its points, the best quality first.
    pub points: fn() -> Vec<Point>,
}

/// The methods beside the [formats](formats) of files. A further one takes a file in `methods` and a row here.
pub const METHODS: [Family; 9] = [
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
    Family {
        name: "haclite",
        about: "anchors, networks, a hash grid that predicts what is coded, trained with its bits (after Chen et al., 2024)",
        points: HacLite::points,
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
