//! Draws one Gaussian and walks back from the picture to the Gaussian and the camera.

use weaver_autograd::Tape;
use weaver_pose::CameraVars;
use weaver_splat::{GaussianVars, RasterSettings, Rasterize, WorkspacePool};

fn main() {
    let (tape, workspaces) = (Tape::<f32>::new(), WorkspacePool::new());
    let gaussians = GaussianVars {
        means: tape.leaf(&[0.0, 0.0, 2.0], [1, 3]),
        quats: tape.leaf(&[1.0, 0.0, 0.0, 0.0], [1, 4]), // wxyz
        scales: tape.leaf(&[0.5, 0.5, 0.5], [1, 3]),
        opacities: tape.leaf(&[0.8], [1]),
        colors: tape.leaf(&[1.0, 0.5, 0.0], [1, 3]),
    };
    let cameras = CameraVars {
        viewmats: tape.leaf(&[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0], [1, 3, 4]),
        intrinsics: tape.leaf(&[10.0, 10.0, 4.5, 4.5], [1, 4]),
    };
    let background = tape.constant(&[0.0; 3], [3]);
    let drawn = Rasterize::new(9, 9, RasterSettings::default(), &workspaces).apply(&gaussians, &cameras, background);
    drawn.image.square().mean().backward();

    let red = drawn.image.value()[3 * (9 * 4 + 4)];
    assert!((red - 0.8).abs() < 1e-3, "opacity times red");
    let gradient = |var: weaver_autograd::Var<'_, f32>| var.grad().expect("every input has a gradient");
    assert!(gradient(gaussians.opacities)[0] > 0.0, "less opacity, less light");
    assert!(gradient(cameras.viewmats).iter().any(|g| *g != 0.0), "the camera has a gradient, too");
    println!("the middle is {red:.3} red; d loss / d opacity = {:.4}", gradient(gaussians.opacities)[0]);
}
