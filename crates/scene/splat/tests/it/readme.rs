//! The example of the workspace's README, word by word.

use weaver_autograd::Tape;
use weaver_pose::CameraVars;

/// The lines of the README, with the names that they take for granted.
#[test]
fn the_readme_draws_and_differentiates() {
    let (width, height) = (8, 6);
    let tape = Tape::<f32>::new();
    let gaussians = GaussianVars {
        means: tape.leaf(&[0.1, -0.05, 2.0], [1, 3]),
        quats: tape.leaf(&[1.0, 0.0, 0.0, 0.0], [1, 4]),
        scales: tape.leaf(&[0.2; 3], [1, 3]),
        opacities: tape.leaf(&[0.7], [1]),
        colors: tape.leaf(&[0.9, 0.5, 0.1], [1, 3]),
    };
    let eye = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let cameras =
        CameraVars { viewmats: tape.leaf(&eye, [1, 3, 4]), intrinsics: tape.constant(&[8.0, 8.0, 4.0, 3.0], [1, 4]) };
    let background = tape.constant(&[1.0; 3], [3]);
    let photo = tape.constant(&[0.5; 6 * 8 * 3], [1, 6, 8, 3]);

    use weaver_splat::{GaussianVars, RasterSettings, Rasterize, WorkspacePool};

    let (workspaces, settings) = (WorkspacePool::new(), RasterSettings::default());
    let drawn = Rasterize::new(width, height, settings, &workspaces).apply(&gaussians, &cameras, background);
    (drawn.image - photo).square().mean().backward();
    let gradient = gaussians.means.grad(); // and of every other parameter, the cameras included

    assert!(gradient.unwrap().iter().all(|g| *g != 0.0));
    assert!(cameras.viewmats.grad().unwrap().iter().any(|g| *g != 0.0));

    let (readme, here) = (include_str!("../../../../../README.md"), include_str!("readme.rs"));
    let example = readme.split("```rust\n").nth(1).and_then(|rest| rest.split("```").next()).expect("one Rust example");
    assert_eq!(readme.matches("```rust").count(), 1, "another example needs another test");
    let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(words(here).contains(&words(example)), "the README has another example than this test:\n{example}");
}
