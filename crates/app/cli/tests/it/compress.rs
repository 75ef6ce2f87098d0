//! `compress`: decibels are reported of pictures without a part in the choice.

use crate::compare::gaussians;
use crate::in_process::splatweaver;
use serde_json::Value;
use std::path::Path;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_io::{Transforms, read_gaussians, write_gaussians};
use weaver_scene::{Frame, Gaussians};
use weaver_splat::Renderer;

/// Cameras side by side.
fn cameras(count: usize) -> Vec<Camera> {
    let intrinsics = Intrinsics { fx: 40.0, fy: 40.0, cx: 20.0, cy: 15.0 };
    let at = |i: usize| DVec3::new(0.15 * i as f64 - 0.5, 0.0, 0.0);
    let pose = |i: usize| Pose::new(Pose::IDENTITY.rotation, at(i));
    (0..count).map(|i| Camera { pose: pose(i), intrinsics, width: 40, height: 30 }).collect()
}

fn write_cameras(path: &Path, cameras: &[Camera]) {
    let frames = cameras.iter().enumerate().map(|(i, camera)| Frame::new(format!("{i}.png"), *camera)).collect();
    Transforms { frames, ..Transforms::default() }.write(path).unwrap();
}

/// Mean PSNR between pictures of two scenes.
fn psnr([a, b]: [&Gaussians; 2], cameras: &[Camera]) -> f64 {
    let draw = |scene: &Gaussians, camera: &Camera| {
        let pictures = Renderer::default().render(&scene.to_activated(), &[*camera], [1.0; 3], &Default::default());
        pictures.unwrap().concat().iter().map(|x| x.clamp(0.0, 1.0)).collect::<Vec<f32>>()
    };
    let of = |camera: &Camera| {
        let [a, b] = [draw(a, camera), draw(b, camera)];
        let sum: f64 = a.iter().zip(&b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        -10.0 * (sum / a.len() as f64).log10()
    };
    cameras.iter().map(of).sum::<f64>() / cameras.len() as f64
}

/// Promise (fits): the decibels of `compress` come from pictures that took no part in the choice of steps.
#[test]
fn decibels_are_those_of_other_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (scene, out, all) = (path("scene.ply"), path("scene.wsz"), cameras(7));
    write_gaussians(&scene, &gaussians()).unwrap();
    write_cameras(&path("cameras.json"), &all);
    let cameras = path("cameras.json");
    let line = |more: &str| {
        let done =
            splatweaver(&[&"compress", &scene, &"-o", &out, &"--cameras", &cameras, &"--background", &"white", &more]);
        done.fine().stdout
    };
    let result: Value = serde_json::from_str(&line("--json")).unwrap();
    assert_eq!((&result["pictures"], &result["chosen_by"]["pictures"]), (&3.into(), &4.into()), "{result}");
    let (before, after) = (read_gaussians(&scene).unwrap(), read_gaussians(&out).unwrap());
    for (first, said) in [(0, &result["chosen_by"]["psnr"]), (1, &result["psnr"])] {
        let some: Vec<Camera> = all.iter().skip(first).step_by(2).copied().collect();
        let expected = psnr([&before, &after], &some);
        assert!((said.as_f64().unwrap() - expected).abs() < 0.02, "{result}: {expected} from camera {first} on");
    }
    let said = line("--threads=1");
    assert!(said.contains(" dB beside the scene in 3 pictures, ") && said.contains("4 that the steps were"), "{said}");
    // Of one camera there is no other.
    write_cameras(&path("cameras.json"), &all[..1]);
    let said = line("--threads=1");
    assert!(said.starts_with("beside the scene ") && said.contains("no other to judge"), "{said}");
}

/// Without cameras, the pictures are of an orbit, as the output says, and choose and judge by turns.
///
/// Promise of `decibels_are_those_of_other_pictures`.
#[test]
fn an_orbit_is_spoken_of() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, out) = (folder.path().join("scene.ply"), folder.path().join("scene.wsz"));
    write_gaussians(&scene, &gaussians()).unwrap();
    let done = splatweaver(&[&"compress", &scene, &"-o", &out]).fine();
    assert!(done.stderr.contains("an orbit around it") && done.stderr.contains("6 others judge"), "{}", done.stderr);
    assert!(done.stdout.contains(" dB beside the scene in 6 pictures"), "{}", done.stdout);
}
