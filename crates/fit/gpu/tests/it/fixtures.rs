//! Stored references by another implementation, the same that the CPU's rasterizer is held to.

use crate::device::{gradients, masked, rasterizer, render};
use crate::scene::{NAMES, Planes, Scene, relative};
use safetensors::SafeTensors;
use std::path::Path;
use weaver_gpu::GpuWorkspace;
use weaver_splat::RasterSettings;

fn floats(file: &SafeTensors<'_>, key: &str) -> Vec<f64> {
    let tensor = file.tensor(key).unwrap_or_else(|_| panic!("the fixture has {key}"));
    tensor.data().chunks_exact(4).map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap()))).collect()
}

/// fx, fy, cx, cy of a 3x3 matrix.
fn intrinsics(k: &[f64]) -> Vec<f64> {
    vec![k[0], k[4], k[2], k[5]]
}

fn check(name: &str, antialiased: bool, degree: Option<usize>) {
    let Some(rasterizer) = rasterizer() else { return };
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../tests/fixtures/raster").join(name);
    let bytes = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let shape = file.tensor("out.image").unwrap().shape().to_vec();
    let scene = Scene {
        means: floats(&file, "in.means"),
        quats: floats(&file, "in.quats"),
        scales: floats(&file, "in.scales"),
        opacities: floats(&file, "in.opacities"),
        colors: floats(&file, if degree.is_some() { "in.sh" } else { "in.colors" }),
        degree,
        colorless: false,
        features: Vec::new(),
        channels: 0,
        model: weaver_scene::Model::Pinhole,
        groups: None,
        viewmats: floats(&file, "in.viewmat"),
        intrinsics: intrinsics(&floats(&file, "in.K")),
        background: floats(&file, "in.background"),
        width: shape[1],
        height: shape[0],
        settings: RasterSettings { antialiased, ..RasterSettings::default() },
    }
    .to_f32();
    let safe: Vec<bool> = file.tensor("safe").unwrap().data().iter().map(|&b| b != 0).collect();
    let read = |kind: &str| Planes {
        image: floats(&file, &format!("{kind}.image")),
        alpha: floats(&file, &format!("{kind}.alpha")),
        depth: floats(&file, &format!("{kind}.depth")),
        features: Vec::new(),
    };
    let mut workspace = GpuWorkspace::default();
    let drawn = masked(&render(&rasterizer, &mut workspace, &scene).0, &safe);
    let expected = masked(&read("out"), &safe);
    let pairs = [
        ("image", &drawn.image, &expected.image),
        ("alpha", &drawn.alpha, &expected.alpha),
        ("depth", &drawn.depth, &expected.depth),
    ];
    for (name, ours, theirs) in pairs {
        let error = relative(ours, theirs, 0.0);
        println!("{name} {error:.1e}");
        assert!(error < 1e-4, "{name}: {error:e}");
    }
    let own = gradients(&rasterizer, &mut workspace, &scene, &read("cot").to_f32());
    let mut compared = 0;
    for (name, own) in NAMES.iter().zip(&own) {
        let key = match *name {
            "colors" if degree.is_some() => "grad.sh".into(),
            "viewmats" => "grad.viewmat".into(),
            "intrinsics" => "grad.K".into(),
            name => format!("grad.{name}"),
        };
        if file.tensor(&key).is_err() {
            continue;
        }
        let theirs = match *name {
            "intrinsics" => intrinsics(&floats(&file, &key)),
            // The last row of the matrix is no input.
            "viewmats" => floats(&file, &key)[..12].iter().copied().chain([0.0; 4]).collect(),
            _ => floats(&file, &key),
        };
        let error = relative(own, &theirs, 0.0);
        println!("gradient of {name} {error:.1e}");
        assert!(error < 1e-4, "gradient of {name}: {error:e}");
        compared += 1;
    }
    assert!(compared >= 7);
}

#[test]
fn spherical_harmonics_and_depth() {
    check("small_sh3_depth.safetensors", false, Some(3));
}

#[test]
fn plain_colors_antialiased() {
    check("small_rgb_antialiased.safetensors", true, None);
}
