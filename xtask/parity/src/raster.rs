//! The rasterizer. The kind of a file follows from its contents: plain colors or harmonics, classic or antialiased.

use super::camera_head::intrinsics;
use super::reference::Reference;
use weaver_autograd::{Real, Tape};
use weaver_pose::CameraVars;
use weaver_splat::{GaussianVars, RasterSettings, Rasterize, WorkspacePool};

/// The bar of these files, whose fragile pixels are marked.
const BAR: f64 = 1e-4;

/// True if the file is about one drawing: a camera, and Gaussians with colors. (Others have cameras too.)
pub fn describes(file: &Reference) -> bool {
    file.has("in.viewmat") && (file.has("in.colors") || file.has("in.sh"))
}

pub fn run<T: Real>(file: Reference) -> Reference {
    let file = file.with_bar(BAR);
    let shape = file.shape("out.image");
    let (height, width) = (shape[shape.len() - 3], shape[shape.len() - 2]);
    let settings = RasterSettings {
        antialiased: file.metadata("mode") == Some("antialiased"),
        near: file.metadata("near").and_then(|n| n.parse().ok()).unwrap_or(RasterSettings::default().near),
        eps2d: file.metadata("eps2d").and_then(|n| n.parse().ok()).unwrap_or(RasterSettings::default().eps2d),
        ..RasterSettings::default()
    };
    let colors = if file.has("in.sh") { "sh" } else { "colors" };
    let workspaces = WorkspacePool::new();
    let tape = Tape::<T>::new();
    let leaf = |name: &str| file.leaf(&tape, &format!("in.{name}"));
    let gaussians = GaussianVars {
        means: leaf("means"),
        quats: leaf("quats"),
        scales: leaf("scales"),
        opacities: leaf("opacities"),
        colors: leaf(colors),
    };
    let cameras = CameraVars {
        viewmats: tape.leaf(&file.data("in.viewmat"), [1, 4, 4]),
        intrinsics: tape.leaf(&intrinsics(&file.data("in.K")), [1, 4]),
    };
    let background = leaf("background");
    let drawn = Rasterize::new(width, height, settings, &workspaces).apply(&gaussians, &cameras, background);
    let safe = file.mask("safe");
    file.check_where("out.image", &drawn.image.value(), |i| safe[i / 3]);
    file.check_where("out.alpha", &drawn.alpha.value(), |i| safe[i]);
    file.check_where("out.depth", &drawn.depth.value(), |i| safe[i]);
    let outputs = [(drawn.image, "cot.image"), (drawn.alpha, "cot.alpha"), (drawn.depth, "cot.depth")];
    let loss = outputs.map(|(y, cot)| file.weighted(y, cot)).into_iter().reduce(|a, b| a + b);
    file.backward(loss.expect("three outputs"));

    let color = format!("grad.{colors}");
    let pairs = [
        ("grad.means", gaussians.means),
        ("grad.quats", gaussians.quats),
        ("grad.scales", gaussians.scales),
        ("grad.opacities", gaussians.opacities),
        (color.as_str(), gaussians.colors),
        ("grad.background", background),
    ];
    for (key, x) in pairs {
        file.check_grad(key, x);
    }
    // Only the first three rows of a matrix are inputs, only four entries of K.
    file.check_where("grad.viewmat", &cameras.viewmats.grad().unwrap_or_default(), |i| i < 12);
    let gradient = super::camera_head::matrices(&cameras.intrinsics.grad().unwrap_or_default(), 0.0);
    file.check_where("grad.K", &gradient, |i| [0, 2, 4, 5].contains(&i));
    file
}
