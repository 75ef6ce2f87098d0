//! Gaussians through every format that holds them.

use crate::shared;
use proptest::prelude::*;
use weaver_geometry::sh;
use weaver_io::{SCENE_FORMATS, SceneFormat, read_gaussians, write_gaussians};
use weaver_scene::Gaussians;

/// Gaussians that every format can hold: scales, opacities and colors within its range.
pub fn gaussians() -> impl Strategy<Value = Gaussians> {
    (0usize..6, 0usize..=3).prop_flat_map(|(n, degree)| {
        (
            prop::collection::vec(prop::array::uniform3(-500.0f32..500.0), n),
            prop::collection::vec(prop::array::uniform3(-9.0f32..5.0), n),
            prop::collection::vec(prop::array::uniform4(-1.0f32..1.0), n),
            prop::collection::vec(-5.0f32..5.0, n),
            prop::collection::vec(-0.9f32..0.9, n * 3 * sh::coefficients(degree)),
        )
            .prop_map(move |(means, log_scales, mut quats, opacity_logits, sh)| {
                quats.iter_mut().filter(|q| q.iter().all(|x| x.abs() < 0.1)).for_each(|q| q[0] = 1.0);
                Gaussians { means, log_scales, quats, opacity_logits, sh, degree }
            })
    })
}

pub fn round_trip(name: &str, gaussians: &Gaussians) -> Gaussians {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    write_gaussians(&path, gaussians).unwrap();
    read_gaussians(&path).unwrap()
}

/// Gaussians in the order in which a format writes them.
pub fn ordered(name: &str, gaussians: &Gaussians) -> Gaussians {
    gaussians.select(&SceneFormat::of(name.as_ref()).unwrap().order(gaussians))
}

/// Largest error of each kind of number.
pub struct Tolerance {
    pub position: f32,
    pub scale: f32,
    /// Degrees.
    pub rotation: f32,
    pub opacity: f32,
    pub color: f32,
    pub harmonics: f32,
}

pub fn assert_near(a: &Gaussians, b: &Gaussians, tolerance: &Tolerance) {
    assert_eq!((a.len(), a.opacity_logits.len()), (b.len(), b.opacity_logits.len()));
    let near = |what: &str, a: &[f32], b: &[f32], tolerance: f32| {
        for (i, (a, b)) in a.iter().zip(b).enumerate() {
            assert!((a - b).abs() <= tolerance, "{what} {i}: {a} {b}");
        }
    };
    near("position", a.means.as_flattened(), b.means.as_flattened(), tolerance.position);
    near("scale", a.log_scales.as_flattened(), b.log_scales.as_flattened(), tolerance.scale);
    let opacity = |g: &Gaussians| g.to_activated().opacities;
    near("opacity", &opacity(a), &opacity(b), tolerance.opacity);
    for (p, q) in a.quats.iter().zip(&b.quats) {
        let norm = |q: &[f32; 4]| q.iter().map(|x| x * x).sum::<f32>().sqrt();
        let cos = p.iter().zip(q).map(|(x, y)| x * y).sum::<f32>() / (norm(p) * norm(q));
        let angle = 2.0 * cos.abs().min(1.0).acos().to_degrees();
        assert!(angle < tolerance.rotation, "{p:?} {q:?}: {angle} degrees");
    }
    let (k, l) = (a.coefficients(), b.coefficients());
    for (a, b) in a.sh.chunks(3 * k).zip(b.sh.chunks(3 * l)) {
        near("color", &a[..3], &b[..3], tolerance.color);
        near("harmonics", &a[3..], &b[3..], tolerance.harmonics);
    }
}

const SPLAT: Tolerance = Tolerance {
    position: 0.0,
    scale: 1e-5,
    rotation: 1.5,
    opacity: 0.51 / 255.0,
    color: 0.51 / 255.0 / 0.282,
    harmonics: 0.0,
};
const SPZ: Tolerance = Tolerance {
    position: 1.5e-4,
    scale: 0.51 / 16.0,
    rotation: 0.3,
    opacity: 0.51 / 255.0,
    color: 0.51 / 255.0 / 0.15,
    harmonics: 0.51 / 128.0,
};

/// Positions and scales in 10 or 11 bits between bounds that are at most 1000 and 14 apart; colors between bounds, too.
const COMPRESSED: Tolerance = Tolerance {
    position: 0.51 * 1000.0 / 1023.0,
    scale: 0.51 * 14.0 / 1023.0,
    rotation: 0.2,
    opacity: 0.51 / 255.0,
    color: 0.51 * 1.8 / 255.0,
    harmonics: 0.51 * 8.0 / 256.0,
};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 5))]

    #[test]
    fn ply_keeps_every_bit(gaussians in gaussians()) {
        prop_assert_eq!(round_trip("a.ply", &gaussians), gaussians);
    }

    #[test]
    fn splat_keeps_positions_and_rounds_the_rest(gaussians in gaussians()) {
        let back = round_trip("a.SPLAT", &gaussians);
        prop_assert_eq!(back.degree, 0);
        assert_near(&gaussians, &back, &SPLAT);
    }

    /// Compressed PLY rounds between bounds and orders anew.
    #[test]
    fn compressed_ply_rounds_and_reorders(gaussians in gaussians()) {
        let back = round_trip("a.compressed.ply", &gaussians);
        prop_assert_eq!((back.len(), back.degree), (gaussians.len(), gaussians.degree));
        assert_near(&ordered("a.compressed.ply", &gaussians), &back, &COMPRESSED);
        // The name of a file does not change its reading.
        let folder = tempfile::tempdir().unwrap();
        let [one, two] = ["1.compressed.ply", "1.ply"].map(|name| folder.path().join(name));
        write_gaussians(&one, &gaussians).unwrap();
        std::fs::copy(&one, &two).unwrap();
        prop_assert_eq!(read_gaussians(&one).unwrap(), read_gaussians(&two).unwrap());
    }

    #[test]
    fn spz_rounds_everything(gaussians in gaussians()) {
        let back = round_trip("a.spz", &gaussians);
        prop_assert_eq!(back.degree, gaussians.degree);
        assert_near(&gaussians, &back, &SPZ);
        // Version 4 holds the same numbers.
        prop_assert_eq!(&round_trip("a.v4.spz", &gaussians), &back);
        // A rounded value stays as it is.
        let again = round_trip("a.spz", &back);
        prop_assert_eq!((&again.means, &again.log_scales, &again.sh), (&back.means, &back.log_scales, &back.sh));
    }
}

#[test]
fn wsz_is_a_tenth_of_ply_and_keeps_what_is_seen() {
    let Some(folder) = shared::data("splat-files") else { return };
    let playbot = read_gaussians(folder.join("playbot-sh2.ply")).unwrap();
    let back = round_trip("a.wsz", &playbot);
    assert_eq!((back.len(), back.degree), (playbot.len(), 2));
    let mut bytes = Vec::new();
    weaver_io::write_gaussians_to(&mut bytes, "wsz".parse().unwrap(), &playbot).unwrap();
    assert!(8 * bytes.len() <= 130 * playbot.len(), "{} bytes", bytes.len());
    let mean = |g: &Gaussians, axis: usize| g.means.iter().map(|m| f64::from(m[axis])).sum::<f64>() / g.len() as f64;
    assert!((0..3).all(|axis| (mean(&playbot, axis) - mean(&back, axis)).abs() < 1e-4));
    bytes.truncate(bytes.len() / 2);
    let cut = weaver_io::read_gaussians_from(&bytes, "wsz".parse().unwrap()).unwrap_err().to_string();
    assert!(cut.contains("bytes, found"), "{cut}");
}

#[test]
fn positions_of_any_size_fit_into_spz() {
    let at = |x: f32| Gaussians {
        means: vec![[x, 1.0, -x]],
        log_scales: vec![[0.0; 3]],
        quats: vec![[1.0, 0.0, 0.0, 0.0]],
        opacity_logits: vec![f32::INFINITY],
        sh: vec![0.0; 3],
        degree: 0,
    };
    for x in [0.0, 2047.5, 100_000.0, 8e6] {
        assert_eq!(round_trip("a.spz", &at(x)).means, at(x).means);
    }
    let folder = tempfile::tempdir().unwrap();
    let message = |name: &str, gaussians: &Gaussians| {
        write_gaussians(folder.path().join(name), gaussians).unwrap_err().to_string()
    };
    let far = message("a.spz", &at(1e7));
    assert!(far.contains("positions to write: expected coordinates below 2^23"), "{far}");
    let unknown = message("a.obj", &at(0.0));
    assert!(
        unknown.contains(
            "file name: expected .ply, .compressed.ply, .splat, .spz, .v4.spz, .sog, meta.json, lod-meta.json, .glb, .gltf, .usda, .usdz, .ksplat or .wsz, found .obj"
        ),
        "{unknown}"
    );
    let read_only = message("a.ksplat", &at(0.0));
    assert!(
        read_only.contains("format: expected one that is written: ply, compressed")
            && read_only.ends_with("found ksplat, which is read only"),
        "{read_only}"
    );
    let broken = Gaussians { quats: vec![], ..at(0.0) };
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
        "a.wsz",
    ] {
        assert!(message(name, &broken).contains("expected 1 Gaussians"), "{name}");
    }
    for name in [
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
        "a.wsz",
    ] {
        assert!(message(name, &at(f32::NAN)).contains("vertex 0, position: expected finite numbers"), "{name}");
    }
}

#[test]
fn files_of_other_tools_survive_writing() {
    let Some(folder) = shared::data("splat-files") else { return };
    let splat = read_gaussians(folder.join("minimal.splat")).unwrap();
    assert_near(&splat, &round_trip("a.splat", &splat), &SPLAT);
    for name in ["minimal-v2.spz", "minimal-v3.spz", "playbot-sh2.v3.spz", "playbot-sh2.v4.spz"] {
        let spz = read_gaussians(folder.join(name)).unwrap();
        assert_near(&spz, &round_trip("a.spz", &spz), &SPZ);
    }
}

/// Files of a folder and of folders in it, with their content.
fn files_in(folder: &std::path::Path) -> Vec<(std::path::PathBuf, Vec<u8>)> {
    let paths = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let content = |path: std::path::PathBuf| match path.is_dir() {
        true => files_in(&path),
        false => vec![(path.clone(), std::fs::read(&path).unwrap())],
    };
    let mut files: Vec<_> = paths.flat_map(content).collect();
    files.sort();
    files
}

/// A scene that a format cannot hold is refused by name, and the file that was there stays.
///
/// Promise (files): a scene that its format cannot hold replaces nothing, in every format.
#[test]
fn what_cannot_be_read_again_replaces_nothing() {
    let one = |mean: f32, log_scale: f32| Gaussians {
        means: vec![[0.0; 3], [mean, 0.0, 0.0]],
        log_scales: vec![[-3.0; 3], [log_scale, -3.0, -3.0]],
        quats: vec![[1.0, 0.0, 0.0, 0.0]; 2],
        opacity_logits: vec![0.0; 2],
        sh: vec![0.0; 6],
        degree: 0,
    };
    let folder = tempfile::tempdir().unwrap();
    let mut refused = Vec::new();
    for format in SCENE_FORMATS.iter().filter(|format| format.is_written()) {
        let path = folder.path().join(format.name).join(match format.writes_one_file() {
            true => format!("scene.{}", format.extension),
            false => format.extension.into(),
        });
        write_gaussians(&path, &one(1.0, -3.0)).unwrap();
        let content = |path: &std::path::Path| files_in(path.parent().unwrap());
        let before = content(&path);
        for (mean, log_scale) in [(f32::INFINITY, -3.0), (1.0, f32::NEG_INFINITY), (f32::NAN, -3.0), (1.0, 1e30)] {
            match write_gaussians(&path, &one(mean, log_scale)) {
                Ok(()) => {
                    assert!(mean.is_finite() && log_scale.is_finite(), "{format}: {mean} {log_scale}");
                    read_gaussians(&path).unwrap();
                    write_gaussians(&path, &one(1.0, -3.0)).unwrap();
                }
                Err(error) => {
                    assert!(error.to_string().starts_with(&path.display().to_string()), "{error}");
                    refused.push((format.name, log_scale));
                }
            }
            assert!(content(&path) == before, "{format}: {mean} {log_scale}");
        }
    }
    // Their scales are exponentials in 32 bits.
    assert!(["splat", "glb", "gltf", "usda", "usdz"].iter().all(|name| refused.contains(&(name, 1e30))), "{refused:?}");
}

/// Rotations keep their direction, however long their quaternions are.
///
/// Promise (files): rotations keep their direction, however long their quaternions are.
#[test]
fn quaternions_of_any_length_are_rotations() {
    for length in [1e-30f32, 1e-22, 1.0, 1e22, 1e38] {
        let gaussians = Gaussians {
            means: vec![[0.0; 3]],
            log_scales: vec![[-3.0; 3]],
            quats: vec![[0.0, 0.6, 0.8, 0.0].map(|x| x * length)],
            opacity_logits: vec![0.0],
            sh: vec![0.0; 3],
            degree: 0,
        };
        let [w, x, y, z] = round_trip("a.glb", &gaussians).quats[0];
        let off = w.abs().max((x.abs() - 0.6).abs()).max((y.abs() - 0.8).abs()).max(z.abs());
        assert!(off < 1e-6, "{length}: {:?}", [w, x, y, z]);
    }
}
