//! The same call, the same bits.

use crate::device::{gradients, rasterizer, render};
use crate::scene::Scene;
use weaver_gpu::GpuWorkspace;

#[test]
fn every_run_has_the_same_bits() {
    let Some(rasterizer) = rasterizer() else { return };
    let scene = Scene::random(11, 300, 2, (70, 50), Some(1)).with_channels(0);
    let cotangents = scene.cotangents(11).to_f32();
    let scene = scene.to_f32();
    let larger = Scene::random(12, 900, 1, (120, 90), Some(3)).with_channels(0);
    let (larger_cotangents, larger) = (larger.cotangents(1).to_f32(), larger.to_f32());
    let run = |workspace: &mut GpuWorkspace| {
        let drawn = render(&rasterizer, workspace, &scene);
        (drawn, gradients(&rasterizer, workspace, &scene, &cotangents))
    };
    let mut workspace = GpuWorkspace::default();
    let first = run(&mut workspace);
    assert!(first.1.iter().flatten().all(|x| x.is_finite()));
    for _ in 0..20 {
        assert!(run(&mut workspace) == first, "another run, other bits");
    }
    // Remains of an earlier drawing are not read.
    render(&rasterizer, &mut workspace, &larger);
    gradients(&rasterizer, &mut workspace, &larger, &larger_cotangents);
    assert!(run(&mut workspace) == first, "other bits after a larger drawing");
    workspace.spoil(rasterizer.context());
    assert!(run(&mut workspace) == first, "other bits after memory was overwritten");
}
