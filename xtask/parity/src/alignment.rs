//! Alignment of cameras: the exponential map, the gradient by a twist, and three descents on a stand-in loss.

use super::reference::Reference;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, Pose, se3};
use weaver_pose::descent::{Descent, Method, twist_gradient};

/// Compares in f64, also where other files are compared in f32.
pub fn run(file: Reference) -> Reference {
    let start: Vec<f64> = file.data("in.w2c");
    let twists: Vec<f64> = file.data("in.twist");
    let map: Vec<f64> = (twists.as_chunks::<6>().0.iter())
        .flat_map(|[a, b, c, d, e, f]| flat(&se3::exp(DVec3::new(*a, *b, *c), DVec3::new(*d, *e, *f))))
        .collect();
    file.check("out.exp", &map);
    gradient_of_the_map(&file, &twists);
    let quadratic = Quadratic { weight: file.data("in.weight"), wanted: file.data("in.wanted") };
    let slopes = quadratic.gradients(&start);
    let poses = start.chunks(12).zip(&slopes);
    let gradients: Vec<f64> = poses.flat_map(|(rows, slopes)| twist_gradient(&pose(rows), slopes)).collect();
    file.check("out.twist_gradient", &gradients);
    let steps = file.size("steps");
    let depths: Vec<f64> = file.data("in.mean_depth");
    let ones = vec![1.0; depths.len()];
    for (method, name, units) in [(Method::NoPoSplat, "noposplat", &ones), (Method::Own, "own", &depths)] {
        let path = quadratic.path(method, &start, units, steps);
        for step in file.sizes("kept") {
            file.check(&format!("out.{name}_step{step}"), &path[step]);
        }
        let losses: Vec<f64> = path[..steps].iter().map(|all| quadratic.loss(all)).collect();
        file.check(&format!("out.{name}_losses"), &losses);
    }
    let path = quadratic.path(Method::TwoXplat, &start, &ones, steps);
    file.check("out.2xplat_returned", &path[steps - 1]);
    let ends: Vec<Pose> = path[steps].chunks(12).map(|rows| pose(rows).inverse()).collect();
    // The file spells it otherwise.
    let centers: Vec<f64> = ends.iter().flat_map(|end| end.translation.to_array()).collect();
    file.check(concat!("out.2xplat_cent", "re"), &centers);
    // That descent does not keep its quaternions at length 1, and a rotation leaves their sign open.
    let expected: Vec<f64> = file.data("out.2xplat_quaternion");
    let of_end = |(end, expected): (&Pose, &[f64])| {
        let [w, x, y, z] = end.wxyz();
        let along: f64 = [x, y, z, w].iter().zip(expected).map(|(a, b)| a * b).sum();
        let length = expected.iter().map(|q| q * q).sum::<f64>().sqrt().copysign(along);
        [x, y, z, w].map(|q| q * length)
    };
    let quaternions: Vec<f64> = ends.iter().zip(expected.chunks(4)).flat_map(of_end).collect();
    file.check("out.2xplat_quaternion", &quaternions);
    file
}

/// The gradient of the map by its twists, as central differences.
fn gradient_of_the_map(file: &Reference, twists: &[f64]) {
    let cotangent: Vec<f64> = file.data("cot.exp");
    let value = |t: &[f64], slopes: &[f64]| {
        let [v, w] = [DVec3::from_slice(t), DVec3::from_slice(&t[3..])];
        flat(&se3::exp(v, w)).iter().zip(slopes).map(|(m, c)| m * c).sum::<f64>()
    };
    let mut gradient = Vec::new();
    for (twist, slopes) in twists.chunks(6).zip(cotangent.chunks(12)) {
        for i in 0..6 {
            let at = |h: f64| {
                let mut moved = twist.to_vec();
                moved[i] += h;
                value(&moved, slopes)
            };
            gradient.push((at(1e-5) - at(-1e-5)) / 2e-5);
        }
    }
    file.check("grad.in.twist", &gradient);
}

fn pose(rows: &[f64]) -> Pose {
    let row = |i: usize| [0, 1, 2, 3].map(|j| rows[4 * i + j]);
    Pose::from_rows(&[row(0), row(1), row(2)]).expect("rows of a rigid motion")
}

fn flat(pose: &Pose) -> [f64; 12] {
    let rows = pose.rows();
    std::array::from_fn(|i| rows[i / 4][i % 4])
}

/// The stand-in loss: the mean over views of half the weighted square of `[A | t]` minus its target.
struct Quadratic {
    weight: Vec<f64>,
    wanted: Vec<f64>,
}

impl Quadratic {
    fn loss(&self, all: &[f64]) -> f64 {
        let squares = all.iter().zip(&self.wanted).zip(&self.weight).map(|((m, w), weight)| weight * (m - w) * (m - w));
        0.5 * squares.sum::<f64>() / (all.len() / 12) as f64
    }

    fn gradients(&self, all: &[f64]) -> Vec<[f64; 12]> {
        let views = all.len() / 12;
        let slope = |i: usize| self.weight[i] * (all[i] - self.wanted[i]) / views as f64;
        (0..views).map(|v| std::array::from_fn(|i| slope(12 * v + i))).collect()
    }

    /// All cameras before each step and after the last.
    fn path(&self, method: Method, start: &[f64], units: &[f64], steps: usize) -> Vec<Vec<f64>> {
        let intrinsics = Intrinsics { fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 };
        let camera = |rows: &[f64]| Camera { pose: pose(rows), intrinsics, width: 1, height: 1 };
        let descents = start.chunks(12).zip(units).map(|(rows, unit)| Descent::new(method, camera(rows), *unit));
        let mut descents: Vec<Descent> = descents.collect();
        let mut path = Vec::new();
        for _ in 0..=steps {
            let all: Vec<f64> = descents.iter().flat_map(|d| flat(&d.camera().pose)).collect();
            for (descent, slopes) in descents.iter_mut().zip(self.gradients(&all)) {
                descent.step(&slopes, [0.0; 2], 1.0);
            }
            path.push(all);
        }
        path
    }
}
