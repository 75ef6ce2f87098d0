//! `mesh` of scenes: from a folder, from a file with cameras, and inputs that make none.

use crate::in_process::splatweaver;
use std::path::Path;
use weaver_geometry::glam::DVec3;
use weaver_geometry::trajectory::orbit;
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_io::ply::{read_points, read_triangles};
use weaver_io::{Image, PhotoFile, Transforms, write_gaussians};
use weaver_scene::{Frame, Gaussians};

/// A ball of green Gaussians of radius 1 as scene.ply, and cameras around it as transforms.json.
fn result(folder: &Path) {
    let mut scene = Gaussians::default();
    for i in 0..4000 {
        let z = 1.0 - (2 * i + 1) as f32 / 4000.0;
        let ((sin, cos), around) = ((i as f32 * 2.399_963).sin_cos(), (1.0 - z * z).sqrt());
        scene.means.push([around * cos, around * sin, z]);
        scene.quats.push([1.0, 0.0, 0.0, 0.0]);
        scene.log_scales.push([0.03_f32.ln(); 3]);
        scene.opacity_logits.push(6.0);
        scene.sh.extend([-1.4, 1.4, -1.4]);
    }
    write_gaussians(folder.join("scene.ply"), &scene).unwrap();
    let poses = [-2.0, 2.0].into_iter().flat_map(|z| orbit(DVec3::new(3.0, 0.0, z), DVec3::ZERO, DVec3::Z, 8));
    cameras(folder, &poses.collect::<Vec<_>>());
}

fn cameras(folder: &Path, poses: &[Pose]) {
    let intrinsics = Intrinsics { fx: 80.0, fy: 80.0, cx: 40.0, cy: 40.0 };
    let camera = |pose: &Pose| Camera { pose: *pose, intrinsics, width: 80, height: 80 };
    let frames = poses.iter().enumerate().map(|(i, pose)| Frame::new(format!("{i}.png"), camera(pose))).collect();
    Transforms { frames, ..Transforms::default() }.write(folder.join("transforms.json")).unwrap();
}

#[test]
fn a_scene_becomes_a_colored_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    result(folder);
    let [scene, cameras, out, again] = ["scene.ply", "transforms.json", "a.ply", "b.ply"].map(|name| folder.join(name));
    let said = splatweaver(&[&"mesh", &folder, &"--out", &out]).fine().stdout;
    assert!(said.contains("triangles") && said.contains("square units"), "{said}");
    let (vertices, triangles) = read_triangles(&out).unwrap();
    let off = |v: &[f32; 3]| (v.iter().map(|x| x * x).sum::<f32>().sqrt() - 1.0).abs();
    assert!(
        triangles.len() > 2000 && vertices.iter().all(|v| off(v) < 3.0 * 0.03 + 2.0 * 0.045),
        "{}",
        triangles.len()
    );
    let colors = read_points(&out).unwrap().colors;
    let green = colors.iter().filter(|[r, g, b]| *g > 150 && *r < 90 && *b < 90).count();
    assert!(10 * green > 9 * colors.len(), "{green} of {}", colors.len());
    // The same from the files alone, on one thread.
    let json = |more: &[&str]| {
        let line: [&dyn AsRef<std::ffi::OsStr>; 9] =
            [&"mesh", &scene, &"--cameras", &cameras, &"--threads", &"1", &"--json", &"--out", &again];
        let more = more.iter().map(|word| word as &dyn AsRef<std::ffi::OsStr>);
        let line: Vec<_> = line.into_iter().chain(more).collect();
        let figures: serde_json::Value = serde_json::from_str(&splatweaver(&line).fine().stdout).unwrap();
        assert_eq!(figures["vertices"], read_triangles(&again).unwrap().0.len());
        assert_eq!(figures["outputs"], serde_json::json!([again.to_str()]));
        figures
    };
    let same = json(&[]);
    assert_eq!(std::fs::read(&again).unwrap(), std::fs::read(&out).unwrap());
    assert!((same["area"].as_f64().unwrap() / (4.0 * std::f64::consts::PI) - 1.0).abs() < 0.2, "{same}");
    // The default cells spelled out differ by roundings, which decide about a few triangles; others are coarser.
    let count = |voxel: f64| json(&["--voxel", &voxel.to_string()])["triangles"].as_u64().unwrap();
    let all = triangles.len() as u64;
    assert!(count(f64::sqrt(13.0) / 80.0).abs_diff(all) < all / 1000);
    assert!(count(0.2) < all / 4);
}

/// Promise of `a_field_tells_its_size_before_it_is_made`.
#[test]
fn what_gives_no_mesh_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    result(folder);
    let [scene, out] = ["scene.ply", "mesh.ply"].map(|name| folder.join(name));
    let line = |more: &[&str]| {
        let words: [&dyn AsRef<std::ffi::OsStr>; 4] = [&"mesh", &folder, &"--out", &out];
        splatweaver(&words.into_iter().chain(more.iter().map(|w| w as &dyn AsRef<std::ffi::OsStr>)).collect::<Vec<_>>())
    };
    splatweaver(&[&"mesh", &scene, &"--out", &out]).refused(2, &["scene.ply", "expected --cameras"]);
    line(&["--far", "0.5"]).refused(1, &["scene.ply", "expected a surface", "nearer than 0.500", "--far"]);
    line(&["--voxel", "0"]).refused(1, &["cells: expected", "above 0"]);
    line(&["--voxel", "1e-12"]).refused(1, &["cells of", "expected at most"]);
    splatweaver(&[&"mesh", &folder, &"--out", &scene]).refused(2, &["scene.ply"]);
    // Side by side, looking the same way.
    cameras(
        folder,
        &[0.0, 0.5, 1.0].map(|x| Pose::new(weaver_geometry::glam::DMat3::IDENTITY, DVec3::new(x, 0.0, 4.0))),
    );
    line(&[]).refused(2, &["transforms.json", "expected --far"]);
    line(&["--far", "9"]).fine();
    assert!(out.exists());
    let empty = folder.join("empty");
    std::fs::create_dir(&empty).unwrap();
    splatweaver(&[&"mesh", &empty, &"--out", &out]).refused(1, &["empty", "run.json"]);
}

/// Triangles, holes and textures are as wanted, in every format; wishes that cannot be met are refused before any work.
#[test]
fn a_mesh_is_made_for_other_programs() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    result(folder);
    let line = |more: &[&dyn AsRef<std::ffi::OsStr>]| {
        let words: [&dyn AsRef<std::ffi::OsStr>; 4] = [&"mesh", &folder, &"--voxel", &"0.1"];
        splatweaver(&words.into_iter().chain(more.iter().copied()).collect::<Vec<_>>())
    };
    let made = tempfile::tempdir().unwrap();
    let made = made.path();
    let [ply, glb, obj] = ["a.ply", "a.glb", "a.obj"].map(|name| made.join(name));
    line(&[&"--triangles", &"500", &"--watertight", &"-o", &ply]).fine();
    let (_, triangles) = read_triangles(&ply).unwrap();
    assert!(triangles.len() <= 500 && triangles.len() > 450, "{}", triangles.len());
    let directed: std::collections::HashSet<(u32, u32)> =
        triangles.iter().flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)]).collect();
    assert!(directed.len() == 3 * triangles.len() && directed.iter().all(|(a, b)| directed.contains(&(*b, *a))));
    let said = line(&[&"--triangles", &"99999999", &"-o", &ply]).fine().stderr;
    assert!(said.contains("stays as it is"), "{said}");
    line(&[&"--triangles", &"0", &"-o", &ply]).refused(2, &["--triangles"]);
    line(&[&"--texture", &"many", &"-o", &glb]).refused(2, &["--texture"]);
    line(&[&"--texture", &"-o", &ply]).refused(1, &["a.ply", "ends with .glb or .obj"]);
    line(&[&"--texture", &"-o", &glb]).refused(1, &["transforms.json", "photos of 16 cameras", "0.png", "8 more"]);
    for i in 0..16 {
        Image::filled(80, 80, [0.2, 0.6, 0.3]).write_png(folder.join(format!("{i}.png"))).unwrap();
    }
    line(&[&"--texture", &"128", &"--triangles", &"600", &"-o", &glb]).fine();
    assert_eq!(&std::fs::read(&glb).unwrap()[..4], b"glTF");
    line(&[&"--texture", &"128", &"--triangles", &"600", &"-o", &obj]).fine();
    let texture = PhotoFile::at(made.join("a.png")).unwrap().read().unwrap();
    assert!(texture.width == 128 && texture.pixels.chunks_exact(3).all(|p| p == [51, 153, 77]));
    // A photo beside is not replaced.
    std::fs::copy(folder.join("0.png"), made.join("0.png")).unwrap();
    line(&[&"--texture", &"128", &"-o", &made.join("0.obj")]).refused(2, &["0.png", "expected no file"]);
}
