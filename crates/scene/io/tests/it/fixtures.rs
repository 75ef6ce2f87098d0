//! Files of Gaussians by other tools, beside those tools' own readings.

use std::path::{Path, PathBuf};
use weaver_scene::Gaussians;

/// A file in the folder of fixtures.
pub fn splats(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/splats").join(name)
}

/// The table `NAME.decoded.csv` beside a file, of degree 0.
pub fn decoded(name: &str) -> Gaussians {
    let text = std::fs::read_to_string(splats(&format!("{name}.decoded.csv"))).unwrap();
    let mut lines = text.lines().map(|line| line.split(',').map(str::trim));
    let names: Vec<&str> = lines.next().unwrap().collect();
    let mut gaussians = Gaussians::default();
    for line in lines {
        let values: Vec<f32> = line.map(|x| x.parse().unwrap()).collect();
        let column = |name: &str| values[names.iter().position(|n| *n == name).unwrap()];
        gaussians.means.push(["x", "y", "z"].map(column));
        gaussians.log_scales.push(["scale_0", "scale_1", "scale_2"].map(column));
        gaussians.quats.push(["rot_0", "rot_1", "rot_2", "rot_3"].map(column));
        gaussians.opacity_logits.push(column("opacity"));
        gaussians.sh.extend(["f_dc_0", "f_dc_1", "f_dc_2"].map(column));
    }
    gaussians
}

/// Checks that every number is within a tolerance, where quaternions may differ in length and sign.
pub fn assert_same(name: &str, found: &Gaussians, expected: &Gaussians, tolerance: f32) {
    assert_eq!((found.len(), found.degree), (expected.len(), expected.degree), "{name}");
    let near = |what: &str, a: &[f32], b: &[f32]| {
        assert_eq!(a.len(), b.len(), "{name}, {what}");
        for (i, (a, b)) in a.iter().zip(b).enumerate() {
            assert!((a - b).abs() <= tolerance, "{name}, {what} {i}: {a} {b}");
        }
    };
    near("position", found.means.as_flattened(), expected.means.as_flattened());
    near("scale", found.log_scales.as_flattened(), expected.log_scales.as_flattened());
    near("opacity", &found.to_activated().opacities, &expected.to_activated().opacities);
    near("color", &found.sh, &expected.sh);
    for (p, q) in found.quats.iter().zip(&expected.quats) {
        let length = |q: &[f32; 4]| q.iter().map(|x| x * x).sum::<f32>().sqrt();
        let dot = p.iter().zip(q).map(|(x, y)| x * y).sum::<f32>() / (length(p) * length(q));
        near("rotation", &p.map(|x| x / length(p)), &q.map(|x| x / length(q) * dot.signum()));
    }
}
