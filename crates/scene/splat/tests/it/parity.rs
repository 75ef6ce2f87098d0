//! Stored references: values and gradients in `f64` of the same rules by another implementation.

use crate::scene::{NAMES, Planes, Scene, relative};
use safetensors::SafeTensors;
use std::path::Path;
use weaver_scene::Model;
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
        groups: None,
        viewmats: floats(&file, "in.viewmat"),
        intrinsics: intrinsics(&floats(&file, "in.K")),
        background: floats(&file, "in.background"),
        width: shape[1],
        height: shape[0],
        model: Model::Pinhole,
        settings: RasterSettings { antialiased, ..RasterSettings::default() },
    };
    let safe: Vec<bool> = file.tensor("safe").unwrap().data().iter().map(|&b| b != 0).collect();
    let masked = |values: Vec<f64>, channels: usize| -> Vec<f64> {
        values.chunks(channels).zip(&safe).flat_map(|(v, &s)| v.iter().map(move |x| if s { *x } else { 0.0 })).collect()
    };
    let read = |kind: &str| Planes {
        image: floats(&file, &format!("{kind}.image")),
        alpha: floats(&file, &format!("{kind}.alpha")),
        depth: floats(&file, &format!("{kind}.depth")),
        features: Vec::new(),
    };
    let (cotangents, expected) = (read("cot"), read("out"));
    let mut gradients: Vec<Option<Vec<f64>>> = Vec::new();
    for name in NAMES {
        let key = match name {
            "colors" if degree.is_some() => "grad.sh".into(),
            "colors" => "grad.colors".into(),
            "viewmats" => "grad.viewmat".into(),
            "intrinsics" => "grad.K".into(),
            name => format!("grad.{name}"),
        };
        gradients.push(file.tensor(&key).is_ok().then(|| match name {
            "intrinsics" => intrinsics(&floats(&file, &key)),
            // The last row of the matrix is no input.
            "viewmats" => floats(&file, &key)[..12].iter().copied().chain([0.0; 4]).collect(),
            _ => floats(&file, &key),
        }));
    }
    assert!(gradients.iter().flatten().count() >= 7);

    // Measured: 5e-8 in f64 (the references are stored in f32); in f32 2e-6 and, antialiased, 1.6e-5.
    compare(&scene.render(), &scene.gradients(&cotangents), (&expected, &gradients), &masked, 1e-6);
    let single = scene.to_f32();
    let cotangents = cotangents.to_f32();
    compare(&single.render(), &single.gradients(&cotangents), (&expected, &gradients), &masked, 3e-5);
}

fn compare<T: weaver_kernels::Real>(
    planes: &Planes<T>,
    gradients: &[Vec<T>; 10],
    (expected, expected_gradients): (&Planes<f64>, &[Option<Vec<f64>>]),
    masked: &impl Fn(Vec<f64>, usize) -> Vec<f64>,
    bar: f64,
) {
    let pairs = [
        ("image", &planes.image, &expected.image, 3),
        ("alpha", &planes.alpha, &expected.alpha, 1),
        ("depth", &planes.depth, &expected.depth, 1),
    ];
    for (name, ours, theirs, channels) in pairs {
        let ours = masked(ours.iter().map(|x| x.to_f64()).collect(), channels);
        let error = relative(&ours, &masked(theirs.clone(), channels), 0.0);
        println!("{name} {error:.1e}");
        assert!(error < bar, "{name}: {error:e}");
    }
    for ((name, ours), theirs) in NAMES.iter().zip(gradients).zip(expected_gradients) {
        if let Some(theirs) = theirs {
            let error = relative(ours, theirs, 0.0);
            println!("gradient of {name} {error:.1e}");
            assert!(error < bar, "gradient of {name}: {error:e}");
        }
    }
}

#[test]
fn spherical_harmonics_and_depth() {
    check("small_sh3_depth.safetensors", false, Some(3));
}

#[test]
fn plain_colors_antialiased() {
    check("small_rgb_antialiased.safetensors", true, None);
}
