//! Takes a Gaussian through all its forms: `cargo run --release -p weaver-scene --example forms`.

use weaver_geometry::glam::DVec3;
use weaver_geometry::trajectory::orbit;
use weaver_geometry::{Camera, Intrinsics};
use weaver_scene::{CameraRows, Gaussians};

fn main() {
    let stored = Gaussians {
        means: vec![[0.0, 0.0, 2.0]],
        log_scales: vec![[-1.0, -2.0, -3.0]],
        quats: vec![[0.8, 0.0, 0.6, 0.0]],
        opacity_logits: vec![2.0],
        sh: vec![1.0, 0.0, -1.0],
        degree: 0,
    };
    let activated = stored.to_activated();
    println!("stored:    log scales {:?}, opacity logit {:?}", stored.log_scales[0], stored.opacity_logits[0]);
    println!("activated: scales     {:?}, opacity       {:?}", activated.scales, activated.opacities[0]);
    let again = activated.to_stored();
    println!("stored:    log scales {:?}, opacity logit {:?}", again.log_scales[0], again.opacity_logits[0]);

    let intrinsics = Intrinsics { fx: 50.0, fy: 50.0, cx: 32.0, cy: 24.0 };
    let poses = orbit(DVec3::ZERO, DVec3::new(0.0, 0.0, 2.0), -DVec3::Y, 2);
    let cameras: Vec<Camera> =
        poses.into_iter().map(|pose| Camera { pose, intrinsics, width: 64, height: 48 }).collect();
    let rows = CameraRows::new(&cameras);
    for (v, row) in rows.viewmats.chunks(12).enumerate() {
        println!("view matrix {v}: {row:.2?}");
    }
}
