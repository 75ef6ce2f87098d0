//! Reference numbers of the exponential map, of the gradient by a twist, and of all three descents.

use safetensors::SafeTensors;
use std::path::Path;
use weaver_align::{Descent, Method, twist_gradient};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, Pose, se3};

struct Fixture(Vec<u8>);

impl Fixture {
    fn open() -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/align.safetensors");
        Self(std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display())))
    }

    fn numbers(&self, key: &str) -> Vec<f64> {
        let file = SafeTensors::deserialize(&self.0).unwrap();
        let tensor = file.tensor(key).unwrap();
        tensor.data().as_chunks().0.iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect()
    }

    #[track_caller]
    fn assert_close(&self, key: &str, found: &[f64]) {
        let expected = self.numbers(key);
        assert_eq!(found.len(), expected.len(), "{key}");
        let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|v| v * v).sum::<f64>().sqrt();
        let error = norm(&mut found.iter().zip(&expected).map(|(f, e)| f - e)) / norm(&mut expected.iter().copied());
        assert!(error <= 1e-6, "{key}: relative error {error:.2e}");
    }
}

fn pose(rows: &[f64]) -> Pose {
    let row = |i: usize| [0, 1, 2, 3].map(|j| rows[4 * i + j]);
    Pose::from_rows(&[row(0), row(1), row(2)]).unwrap()
}

fn flat(pose: &Pose) -> [f64; 12] {
    let rows = pose.rows();
    std::array::from_fn(|i| rows[i / 4][i % 4])
}

#[test]
fn twists_equal_the_reference() {
    let file = Fixture::open();
    let twists = file.numbers("in.twist");
    let map: Vec<f64> = (twists.as_chunks::<6>().0.iter())
        .flat_map(|[a, b, c, d, e, f]| flat(&se3::exp(DVec3::new(*a, *b, *c), DVec3::new(*d, *e, *f))))
        .collect();
    file.assert_close("out.exp", &map);
    let (poses, slopes) = (file.numbers("in.w2c"), Quadratic::of(&file).gradients(&file.numbers("in.w2c")));
    let gradients: Vec<f64> =
        poses.chunks(12).zip(&slopes).flat_map(|(rows, slopes)| twist_gradient(&pose(rows), slopes)).collect();
    file.assert_close("out.twist_gradient", &gradients);
}

/// The stand-in loss: the mean over views of half the weighted square of `[A | t]` less what is wanted.
struct Quadratic {
    weight: Vec<f64>,
    wanted: Vec<f64>,
}

impl Quadratic {
    fn of(file: &Fixture) -> Self {
        Self { weight: file.numbers("in.weight"), wanted: file.numbers("in.wanted") }
    }

    fn loss(&self, all: &[f64]) -> f64 {
        let squares = all.iter().zip(&self.wanted).zip(&self.weight).map(|((m, w), weight)| weight * (m - w) * (m - w));
        0.5 * squares.sum::<f64>() / (all.len() / 12) as f64
    }

    fn gradients(&self, all: &[f64]) -> Vec<[f64; 12]> {
        let views = all.len() / 12;
        let slope = |i: usize| self.weight[i] * (all[i] - self.wanted[i]) / views as f64;
        (0..views).map(|v| std::array::from_fn(|i| slope(12 * v + i))).collect()
    }
}

/// All cameras before each step and after the last.
fn run(method: Method, file: &Fixture, steps: usize) -> Vec<Vec<f64>> {
    let quadratic = Quadratic::of(file);
    let units = if method == Method::Own { file.numbers("in.mean_depth") } else { vec![1.0; 2] };
    let intrinsics = Intrinsics { fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 };
    let start = file.numbers("in.w2c");
    let camera = |rows: &[f64]| Camera { pose: pose(rows), intrinsics, width: 1, height: 1 };
    let mut descents: Vec<Descent> =
        start.chunks(12).zip(&units).map(|(rows, unit)| Descent::new(method, camera(rows), *unit)).collect();
    let mut path = Vec::new();
    for _ in 0..=steps {
        let all: Vec<f64> = descents.iter().flat_map(|d| flat(&d.camera().pose)).collect();
        for (descent, slopes) in descents.iter_mut().zip(quadratic.gradients(&all)) {
            descent.step(&slopes, [0.0; 2], 1.0);
        }
        path.push(all);
    }
    path
}

#[test]
fn descents_equal_the_reference() {
    let file = Fixture::open();
    for (method, name) in [(Method::NoPoSplat, "noposplat"), (Method::Own, "own")] {
        let path = run(method, &file, 40);
        for step in [1, 2, 10, 40] {
            file.assert_close(&format!("out.{name}_step{step}"), &path[step]);
        }
        let losses: Vec<f64> = path[..40].iter().map(|all| Quadratic::of(&file).loss(all)).collect();
        file.assert_close(&format!("out.{name}_losses"), &losses);
    }
    let path = run(Method::TwoXplat, &file, 40);
    file.assert_close("out.2xplat_returned", &path[39]);
    let ends: Vec<Pose> = path[40].chunks(12).map(|rows| pose(rows).inverse()).collect();
    let centers: Vec<f64> = ends.iter().flat_map(|end| end.translation.to_array()).collect();
    // The file spells it otherwise.
    file.assert_close(concat!("out.2xplat_cent", "re"), &centers);
    let expected = file.numbers("out.2xplat_quaternion");
    for (end, q) in ends.iter().zip(expected.chunks(4)) {
        let stored = Pose::from_wxyz([q[3], q[0], q[1], q[2]], end.translation);
        assert!(stored.angle_to(end) < 1e-6, "{}", stored.angle_to(end));
    }
}
