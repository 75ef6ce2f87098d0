use crate::shared;
use weaver_io::safetensors::Tensors;
use weaver_io::{Drawing, Image, info, write_lidar_scan, write_npy, write_scene};
use weaver_scene::Gaussians;

#[test]
fn describes_what_it_reads() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    Image::filled(3, 2, [1.0, 0.5, 0.0]).write_png(path("a.png")).unwrap();
    assert!(info(path("a.png")).unwrap().starts_with("image, 3x2 pixels\nred    1.0000 to 1.0000"));

    let mut tensors = Tensors::default();
    tensors.metadata.insert("step".into(), "7".into());
    tensors.insert("w", &[2, 2], vec![0.0f32; 4]);
    tensors.write(path("a.safetensors")).unwrap();
    let text = info(path("a.safetensors")).unwrap();
    assert_eq!(text, "safetensors, 1 tensors, 4 values, 112 B\nstep: 7\nw F32 [2, 2]");

    let one = Gaussians {
        means: vec![[0.0; 3]],
        log_scales: vec![[0.0; 3]],
        quats: vec![[1.0, 0.0, 0.0, 0.0]],
        opacity_logits: vec![0.0],
        sh: vec![0.0; 12],
        degree: 1,
    };
    for name in [
        "a.ply",
        "a.compressed.ply",
        "a.splat",
        "a.spz",
        "a.v4.spz",
        "a.sog",
        "meta.json",
        "a.glb",
        "a.gltf",
        "a.usda",
        "a.usdz",
    ] {
        write_scene(path(name), &one, Drawing::antialiased(true)).unwrap();
        let text = info(path(name)).unwrap();
        assert!(text.starts_with("Gaussians, 1 of SH degree ") && text.contains("\nopacity  0.5"), "{name}: {text}");
        let says = !["a.splat", "a.glb", "a.gltf", "a.usda", "a.usdz"].contains(&name);
        assert_eq!(text.contains(", trained antialiased\n"), says, "{name}");
    }

    std::fs::write(path("a.xyz"), "").unwrap();
    for name in ["a.xyz", "missing.ply"] {
        assert!(info(path(name)).unwrap_err().to_string().contains(name));
    }
}

#[test]
fn describes_real_files() {
    let expectations = [
        ("fox", "COLMAP cameras, 1\n216x384 pixels, fx 286.213"),
        ("fox/sparse/0", "COLMAP points, 12741"),
        ("fox/sparse/0/images.bin", "COLMAP images, 50 with 85926 observations"),
        ("fox/sparse/0/points3D.bin", "COLMAP points, 12741"),
        ("fox/transforms.json", "transforms.json, 50 frames (split: 43 train, 7 val, 7 test)"),
        ("fox/images/0001.jpg", "image, 216x384 pixels"),
        ("splat-files/playbot-sh2.ply", "Gaussians, 8406 of SH degree 2"),
        ("splat-files/playbot-sh2.v3.spz", "Gaussians, 8406 of SH degree 2"),
        ("splat-files/playbot-sh2.v4.spz", "Gaussians, 8406 of SH degree 2"),
        ("splat-files/minimal.ksplat", "Gaussians, 4 of SH degree 0"),
        ("splat-files/minimal.splat", "Gaussians, 4 of SH degree 0"),
    ];
    for (name, expected) in expectations {
        let Some(path) = shared::data(name) else { return };
        let text = info(path).unwrap();
        assert!(text.contains(expected) && text.lines().count() < 40, "{text}");
    }
}

/// Folders are described by their content, so are scans and arrays, and a folder of nothing is no missing file of
/// COLMAP's.
///
/// Promise of `runs_of_every_command_are_described`.
#[test]
fn folders_scans_and_arrays_are_described() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let message = info(folder.path()).unwrap_err().to_string();
    assert!(
        message.contains("folder: expected a run, a COLMAP model") && message.contains("none of them"),
        "{message}"
    );
    write_lidar_scan(path("a.bin"), &[[1.0, 2.0, 3.0], [4.0, f32::NAN, 5.0]]).unwrap();
    let text = info(path("a.bin")).unwrap();
    assert!(text.starts_with("scan of a lidar, 2 points\nforward  1.0000 to 4.0000, mean 2.5000 m"), "{text}");
    assert!(text.contains("\nleft     2.0000 to 2.0000"), "{text}");
    write_npy(path("a.npy"), &[2, 3], &[0.0; 6]).unwrap();
    assert_eq!(info(path("a.npy")).unwrap(), "NPY, an array of [2, 3]");
    Image::filled(3, 2, [1.0, 0.5, 0.0]).write_png(path("a.png")).unwrap();
    let text = info(folder.path()).unwrap();
    assert!(text.starts_with("1 photos; the first, ") && text.contains("image, 3x2 pixels"), "{text}");
}
