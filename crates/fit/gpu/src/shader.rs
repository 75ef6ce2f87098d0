//! The shaders: which files make up each, and where it is entered.
//!
//! The files are in `shaders/`, one for each pass and some that passes share. WGSL has no imports: the shared files of
//! a pass are put in front of it.

/// A file of WGSL.
#[derive(Clone, Copy, Debug)]
pub struct File {
    /// Its name in `shaders/`.
    pub name: &'static str,
    /// Its text.
    pub text: &'static str,
}

macro_rules! file {
    ($name:literal) => {
        File { name: $name, text: include_str!(concat!("../shaders/", $name)) }
    };
}

const DISPATCH: File = file!("dispatch.wgsl");
const FINITE: File = file!("finite.wgsl");
const VIEW: File = file!("view.wgsl");
const SPLAT: File = file!("splat.wgsl");
const OUTLINE: File = file!("outline.wgsl");
const PROJECTION: File = file!("projection.wgsl");
const HARMONICS: File = file!("harmonics.wgsl");
const SCAN: File = file!("scan.wgsl");
const SORT: File = file!("sort.wgsl");
const SUM: File = file!("sum.wgsl");
const LOSS: File = file!("loss.wgsl");
const ADAM: File = file!("adam.wgsl");

/// A pass: files one behind the other, and the function that the device starts.
#[derive(Clone, Copy, Debug)]
pub struct Shader {
    /// The function.
    pub entry: &'static str,
    /// The files; the last one has the function.
    pub files: &'static [File],
}

impl Shader {
    /// The text that is compiled.
    pub fn source(&self) -> String {
        self.files.iter().flat_map(|file| [file.text, "\n"]).collect()
    }

    /// The file that holds the pass.
    pub fn file(&self) -> &'static str {
        self.files.last().map_or("", |file| file.name)
    }
}

/// The passes, by their places in [`SHADERS`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Kernel {
    /// Gaussians to splats, depth keys and numbers of tiles.
    Project,
    /// Digits of keys counted.
    Count,
    /// Places of the keys of each digit.
    ScanCounts,
    /// Keys and values to their places.
    Scatter,
    /// Tiles of groups of Gaussians summed.
    SumGroups,
    /// The groups' sums made running ones.
    ScanGroups,
    /// Start of the entries of each Gaussian.
    Place,
    /// The entries.
    Emit,
    /// Start of the list of each tile.
    Start,
    /// Lists to pixels.
    Composite,
    /// Pixels' cotangents to sums per entry.
    Moments,
    /// Sums to gradients of Gaussians.
    Gaussian,
    /// The camera's gradient from its parts.
    Camera,
    /// By-products for density control.
    Statistics,
    /// Means of windows along rows.
    WindowRows,
    /// Similarity of windows, and its derivatives.
    WindowMaps,
    /// Derivatives of windows to the rows below them.
    SpreadMaps,
    /// The loss of an image, and its gradient.
    Compare,
    /// The loss from its parts.
    SumLosses,
    /// A step of the optimizer on parameters of Gaussians.
    DescendParams,
    /// A step of the optimizer on their colors.
    DescendColor,
}

/// All shaders, in the order of [`Kernel`].
pub const SHADERS: [Shader; 21] = [
    Shader {
        entry: "project",
        files: &[DISPATCH, FINITE, VIEW, SPLAT, OUTLINE, PROJECTION, HARMONICS, file!("project.wgsl")],
    },
    Shader { entry: "count", files: &[DISPATCH, SCAN, SORT] },
    Shader { entry: "scan_counts", files: &[DISPATCH, SCAN, SORT] },
    Shader { entry: "scatter", files: &[DISPATCH, SCAN, SORT] },
    Shader { entry: "sum_groups", files: &[DISPATCH, SCAN, SUM] },
    Shader { entry: "scan_groups", files: &[DISPATCH, SCAN, SUM] },
    Shader { entry: "place", files: &[DISPATCH, SCAN, SUM] },
    Shader { entry: "emit", files: &[DISPATCH, VIEW, SPLAT, OUTLINE, file!("emit.wgsl")] },
    Shader { entry: "start", files: &[DISPATCH, file!("start.wgsl")] },
    Shader { entry: "composite", files: &[DISPATCH, VIEW, SPLAT, file!("composite.wgsl")] },
    Shader { entry: "sum_moments", files: &[DISPATCH, VIEW, SPLAT, file!("moments.wgsl")] },
    Shader { entry: "differentiate", files: &[DISPATCH, FINITE, VIEW, PROJECTION, HARMONICS, file!("gaussian.wgsl")] },
    Shader { entry: "sum_parts", files: &[file!("camera.wgsl")] },
    Shader { entry: "tally", files: &[DISPATCH, FINITE, VIEW, file!("statistics.wgsl")] },
    Shader { entry: "window_rows", files: &[DISPATCH, LOSS] },
    Shader { entry: "window_maps", files: &[DISPATCH, LOSS] },
    Shader { entry: "spread_maps", files: &[DISPATCH, LOSS] },
    Shader { entry: "compare", files: &[DISPATCH, LOSS] },
    Shader { entry: "sum_losses", files: &[DISPATCH, LOSS] },
    Shader { entry: "descend_params", files: &[DISPATCH, ADAM] },
    Shader { entry: "descend_color", files: &[DISPATCH, ADAM] },
];
