//! The equations and their solution beside ones that share no code with them.

mod solvers;

use super::descent::{Descent, Limits};
use super::structure::NONE;
use super::*;
use weaver_geometry::glam::DMat3;
use weaver_geometry::{Intrinsics, se3, so3};
use weaver_kernels::random::Stream;

const NUMBERS: usize = 5;

/// Cameras, fixed after the third, two lenses and points without any order.
fn bundle(seed: u64) -> Bundle {
    let stream = Stream::new(seed, 0, "test.equations");
    let draw = |k: u64| DVec3::new(stream.normal(k), stream.normal(k + 1), stream.normal(k + 2));
    let intrinsics = Intrinsics { fx: 30.0, fy: 28.0, cx: 16.0, cy: 12.0 };
    let camera = |i: u64| {
        let pose = Pose::new(so3::exp(draw(10 * i) * 0.2), draw(10 * i + 3) * 0.3 + DVec3::Z * 5.0);
        Camera { pose, intrinsics, width: 32, height: 24 }
    };
    let observation = |i: usize| {
        let at = draw(1000 + 3 * i as u64);
        let pixel = DVec2::new(16.0 + 4.0 * at.x, 12.0 + 4.0 * at.y);
        Observation { camera: (3 * i) % 4, point: i / 4, pixel, deviation: 1.0 + 0.3 * at.z.abs() }
    };
    let cameras: Vec<Camera> = (0..4).map(camera).collect();
    let turned = |c: &Camera| Pose::new(so3::exp(DVec3::new(0.3, -0.2, 0.1)) * c.pose.rotation, c.pose.translation);
    let lens = Lens {
        log_focal: 0.1,
        k1: -0.2,
        k2: 0.05,
        shift: DVec2::new(0.02, -0.01),
        expected: 0.3,
        weight: 3.0,
        distortion_weight: 1.5,
        shift_weight: 2.0,
        free_focal: true,
        free_k1: true,
        free_k2: true,
        free_shift: true,
    };
    Bundle {
        expected: cameras.iter().map(|c| (turned(c), [0.7, 0.6, 0.5, 0.4, 0.3, 0.2])).collect(),
        cameras,
        lenses: vec![lens, Lens { free_k2: seed.is_multiple_of(2), free_focal: false, ..lens }],
        lens_of: vec![0, 1, 0, seed.is_multiple_of(3).into()],
        fixed: vec![false, false, false, true],
        rig: Vec::new(),
        points: (0..6).map(|i| draw(500 + 3 * i)).collect(),
        fixed_points: false,
        observations: (0..24).map(observation).collect(),
    }
}

/// The same with the second and the third camera in a rig, or the last two, which are fixed.
fn rigged(seed: u64) -> Bundle {
    let mut bundle = bundle(seed);
    let first = 1 + seed as usize % 2;
    // By little, so that points stay in front.
    let turn = so3::exp(DVec3::new(0.15, -0.2, 0.3) * (1.0 + seed as f64 / 20.0));
    let alone = |on: usize| Mounted { on, rotation: DMat3::IDENTITY };
    bundle.rig = (0..4).map(alone).collect();
    bundle.rig[first + 1] = Mounted { on: first, rotation: turn };
    bundle.lens_of[first + 1] = bundle.lens_of[first];
    bundle.fixed[first] = first == 2;
    bundle.put(first, bundle.cameras[first].pose);
    bundle
}

/// Number of everything that moves: cameras, lenses and points, whether free or not.
fn numbers(bundle: &Bundle) -> usize {
    TWIST * bundle.cameras.len() + NUMBERS * bundle.lenses.len() + 3 * bundle.points.len()
}

/// The bundle with one of them moved.
fn moved(bundle: &Bundle, at: usize, by: f64) -> Bundle {
    let mut other = bundle.clone();
    let lenses = TWIST * bundle.cameras.len();
    let points = lenses + NUMBERS * bundle.lenses.len();
    if at >= points {
        other.points[(at - points) / 3][(at - points) % 3] += by;
    } else if at >= lenses {
        let lens = &mut other.lenses[(at - lenses) / NUMBERS];
        let DVec2 { x, y } = &mut lens.shift;
        *[&mut lens.log_focal, &mut lens.k1, &mut lens.k2, x, y][(at - lenses) % NUMBERS] += by;
    } else {
        let mut twist = [0.0; TWIST];
        twist[at % TWIST] = by;
        let [a, b, c, d, e, f] = twist;
        let moved = se3::exp(DVec3::new(a, b, c), DVec3::new(d, e, f)).compose(&other.cameras[at / TWIST].pose);
        other.put(at / TWIST, moved);
    }
    other
}

fn free(bundle: &Bundle, at: usize) -> bool {
    let lenses = TWIST * bundle.cameras.len();
    let points = lenses + NUMBERS * bundle.lenses.len();
    if at >= points {
        !bundle.fixed_points
    } else if at >= lenses {
        let lens = &bundle.lenses[(at - lenses) / NUMBERS];
        [lens.free_focal, lens.free_k1, lens.free_k2, lens.free_shift, lens.free_shift][(at - lenses) % NUMBERS]
    } else {
        !bundle.fixed[at / TWIST] && bundle.leads(at / TWIST)
    }
}

/// The derivative of a vector by a number, of the tenth order.
fn derivative(bundle: &Bundle, at: usize, h: f64, of: impl Fn(&Bundle) -> Vec<f64>) -> Vec<f64> {
    const WEIGHTS: [f64; 5] = [5.0 / 6.0, -5.0 / 21.0, 5.0 / 84.0, -5.0 / 504.0, 1.0 / 1260.0];
    let mut sum = vec![0.0; of(bundle).len()];
    for (k, weight) in WEIGHTS.into_iter().enumerate() {
        let by = (k + 1) as f64 * h;
        let (up, down) = (of(&moved(bundle, at, by)), of(&moved(bundle, at, -by)));
        sum.iter_mut().zip(up).zip(down).for_each(|((sum, up), down)| *sum += weight * (up - down) / h);
    }
    sum
}

/// Differences with the roots of their weights: of observations as the loss has them where all is, then of priors.
fn differences(bundle: &Bundle) -> Vec<f64> {
    let of_observation = |o: &Observation| {
        let camera = &bundle.cameras[o.camera];
        let lens = &bundle.lenses[bundle.lens_of[o.camera]];
        ((lens.project(camera, camera.pose.apply(bundle.points[o.point])) - o.pixel) / o.deviation).to_array()
    };
    let mut all: Vec<f64> = bundle.observations.iter().flat_map(of_observation).collect();
    for (i, (pose, weights)) in bundle.expected.iter().enumerate().filter(|(i, _)| free(bundle, TWIST * i)) {
        let (v, w) = se3::log(&bundle.cameras[i].pose.relative_to(pose));
        all.extend([v.x, v.y, v.z, w.x, w.y, w.z].iter().zip(weights).map(|(x, weight)| x * weight.sqrt()));
    }
    for lens in &bundle.lenses {
        all.extend([
            f64::from(lens.free_focal) * lens.weight.sqrt() * (lens.log_focal - lens.expected),
            f64::from(lens.free_k1) * lens.distortion_weight.sqrt() * lens.k1,
            f64::from(lens.free_k2) * lens.distortion_weight.sqrt() * lens.k2,
            f64::from(lens.free_shift) * lens.shift_weight.sqrt() * lens.shift.x,
            f64::from(lens.free_shift) * lens.shift_weight.sqrt() * lens.shift.y,
        ]);
    }
    all
}

/// The weight of each difference.
fn weights(bundle: &Bundle, scale: f64) -> Vec<f64> {
    let differences = differences(bundle);
    let seen = 2 * bundle.observations.len();
    let weight = |i: usize| {
        let far = |i: usize| (differences[i / 2 * 2].powi(2) + differences[i / 2 * 2 + 1].powi(2)) / (scale * scale);
        if i < seen { 1.0 / (1.0 + far(i)) } else { 1.0 }
    };
    (0..differences.len()).map(weight).collect()
}

/// Elimination with the largest pivot of each column.
fn solved(mut matrix: Vec<Vec<f64>>, mut right: Vec<f64>) -> Vec<f64> {
    let n = right.len();
    for i in 0..n {
        let pivot = (i..n).max_by(|a, b| matrix[*a][i].abs().total_cmp(&matrix[*b][i].abs())).expect("rows");
        matrix.swap(i, pivot);
        right.swap(i, pivot);
        for j in i + 1..n {
            let factor = matrix[j][i] / matrix[i][i];
            let (above, below) = matrix.split_at_mut(j);
            below[0].iter_mut().zip(&above[i]).for_each(|(x, y)| *x -= factor * y);
            right[j] -= factor * right[i];
        }
    }
    for i in (0..n).rev() {
        let rest: f64 = (i + 1..n).map(|k| matrix[i][k] * right[k]).sum();
        right[i] = (right[i] - rest) / matrix[i][i];
    }
    right
}

/// A number of the adjustment: of its right side, or of its step.
fn taken(descent: &mut Descent<'_>, bundle: &Bundle, at: usize, damping: Option<f64>) -> f64 {
    let lenses = TWIST * bundle.cameras.len();
    let points = lenses + NUMBERS * bundle.lenses.len();
    if at >= points {
        let (point, axis) = ((at - points) / 3, (at - points) % 3);
        let part = &mut descent.parts[0];
        let point = part.numbers.iter().position(|number| *number as usize == point).expect("one part has all");
        return damping.map_or(part.right[point][axis], |damping| part.movement(point, &descent.step, damping)[axis]);
    }
    let (block, number) = if at >= lenses {
        (descent.blocks.of_lens[(at - lenses) / NUMBERS], (at - lenses) % NUMBERS)
    } else {
        (descent.blocks.of_camera[at / TWIST], at % TWIST)
    };
    if block == NONE {
        return 0.0;
    }
    if damping.is_some() { descent.step[block as usize][number] } else { descent.system.right[block as usize][number] }
}

/// The right side is minus half the gradient of the cost.
#[test]
fn the_right_side_is_the_slope_of_the_cost() {
    for bundle in (0..20).flat_map(|seed| [bundle(seed), rigged(seed)]) {
        let cost = |of: &Bundle| vec![Descent::new(of, 3.0, &Limits::USUAL).linearize()];
        let mut descent = Descent::new(&bundle, 3.0, &Limits::USUAL);
        descent.linearize();
        for at in (0..numbers(&bundle)).filter(|at| free(&bundle, *at)) {
            let slope = derivative(&bundle, at, 3e-3, cost)[0];
            let right = taken(&mut descent, &bundle, at, None);
            let error = (slope + 2.0 * right).abs();
            assert!(error < 1e-8 * slope.abs().max(1.0), "{at}: {slope} and {}", -2.0 * right);
        }
    }
}

/// Eliminating points, the blocks and the factors change nothing: the step solves the whole damped normal equations,
/// which are built here from differences alone.
#[test]
fn the_step_solves_the_damped_normal_equations() {
    let both = |seed: u64| [bundle(seed), rigged(seed)];
    for (seed, fixed_points) in (0..12).flat_map(|seed| [(seed, false), (seed, true)]) {
        for bundle in both(seed) {
            step_solves(seed, &Bundle { fixed_points, ..bundle });
        }
    }
}

fn step_solves(seed: u64, bundle: &Bundle) {
    let scale = 3.0;
    let damping = 1e-3;
    let free: Vec<usize> = (0..numbers(bundle)).filter(|at| free(bundle, *at)).collect();
    let by: Vec<Vec<f64>> = free.iter().map(|at| derivative(bundle, *at, 3e-3, differences)).collect();
    let off = differences(bundle);
    let weights = weights(bundle, scale);
    let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).zip(&weights).map(|((a, b), w)| a * b * w).sum() };
    let mut matrix: Vec<Vec<f64>> = by.iter().map(|a| by.iter().map(|b| dot(a, b)).collect()).collect();
    (0..free.len()).for_each(|i| matrix[i][i] *= 1.0 + damping);
    let expected = solved(matrix, by.iter().map(|a| -dot(a, &off)).collect());
    let largest = expected.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    for (dense, profile) in [(0, 0), (0, 1000), (200, 0)] {
        // Without a dense matrix or a profile, even few blocks go to conjugate gradients.
        let limits = Limits { dense, profile, tolerance: 1e-14, iterations: 1000, ..Limits::USUAL };
        let mut descent = Descent::new(bundle, scale, &limits);
        descent.linearize();
        assert!(descent.solve(damping));
        for (at, expected) in free.iter().zip(&expected) {
            let found = taken(&mut descent, bundle, *at, Some(damping));
            let error = (found - expected).abs();
            assert!(error < 1e-9 * largest, "{seed}, {limits:?}, {at}: {found}, not {expected} of at most {largest}");
        }
    }
}

/// Cameras on an arc, each point seen by some that follow each other, with noise.
fn chain(cameras: usize, points: usize) -> Bundle {
    let stream = Stream::new(3, 0, "test.chain");
    let draw = |k: usize| DVec3::new(stream.normal(k as u64), stream.normal(k as u64 + 1), stream.normal(k as u64 + 2));
    let intrinsics = Intrinsics { fx: 300.0, fy: 300.0, cx: 160.0, cy: 120.0 };
    let camera = |i: usize| {
        let turn = so3::exp(draw(3 * i) * 0.1) * so3::exp(DVec3::Y * (0.1 * i as f64));
        Camera { pose: Pose::new(turn, DVec3::Z * 5.0), intrinsics, width: 320, height: 240 }
    };
    let lens = Lens { free_focal: true, free_k1: true, ..Lens::default() };
    let mut bundle = Bundle {
        cameras: (0..cameras).map(camera).collect(),
        lenses: vec![lens; 2],
        lens_of: (0..cameras).map(|i| i % 2).collect(),
        fixed: vec![false; cameras],
        points: (0..points).map(|i| draw(1000 + 100 * i) * 0.5).collect(),
        ..Bundle::default()
    };
    for point in 0..points {
        let first = point % (cameras - 5);
        for k in 0..6 {
            let camera = &bundle.cameras[first + k];
            let noise = draw(1003 + 100 * point + 3 * k).truncate() * 0.3;
            let pixel = lens.project(camera, camera.pose.apply(bundle.points[point])) + noise;
            bundle.observations.push(Observation { camera: first + k, point, pixel, deviation: 1.0 });
        }
    }
    bundle
}

/// Both solutions of the reduced equations agree.
#[test]
fn conjugate_gradients_end_where_the_factors_do() {
    let truth = chain(40, 600);
    let [dense, sparse, profile] = [(200, 0), (0, 0), (0, 100_000)].map(|(dense, profile)| {
        let mut bundle = truth.clone();
        // Only one place is left to end at.
        (bundle.fixed[0], bundle.fixed[39]) = (true, true);
        let solved = bundle.adjust_within(3.0, 100, &Limits { dense, profile, settled: 0.0, ..Limits::USUAL });
        assert!(solved.converged, "{solved:?}");
        bundle
    });
    for other in [sparse, profile] {
        for (a, b) in dense.cameras.iter().zip(&other.cameras) {
            assert!(a.pose.angle_to(&b.pose) < 1e-6 && a.pose.center().distance(b.pose.center()) < 1e-6);
        }
        let farthest = dense.points.iter().zip(&other.points).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        assert!(farthest < 1e-6, "{farthest}");
        assert!((dense.lenses[1].log_focal - other.lenses[1].log_focal).abs() < 1e-6);
    }
}

/// The rest of the way when an adjustment ends is small.
#[test]
fn an_adjustment_ends_where_cameras_are_settled() {
    let mut truth = chain(20, 300);
    (truth.fixed[0], truth.fixed[19]) = (true, true);
    // Every other point is so far away that its distance is undetermined: it would move on for long.
    for o in truth.observations.iter_mut().filter(|o| o.point % 2 == 0) {
        let middle = &truth.cameras[o.point % 15 + 3];
        let spread = truth.points[o.point].truncate() * 0.1;
        let far = middle.pose.inverse().apply(spread.extend(1.0) * 3000.0);
        let camera = &truth.cameras[o.camera];
        let noise = o.pixel - truth.lenses[0].project(camera, camera.pose.apply(truth.points[o.point]));
        o.pixel = truth.lenses[0].project(camera, camera.pose.apply(far)) + noise;
    }
    for point in (0..truth.points.len()).step_by(2) {
        let spread = truth.points[point].truncate() * 0.1;
        truth.points[point] = truth.cameras[point % 15 + 3].pose.inverse().apply(spread.extend(1.0) * 300.0);
    }
    let adjusted = |settled: f64| {
        let mut bundle = truth.clone();
        let solved = bundle.adjust_within(3.0, 200, &Limits { settled, ..Limits::USUAL });
        assert!(solved.converged, "{solved:?}");
        (bundle, solved.steps)
    };
    let (end, all) = adjusted(0.0);
    let deviations = end.covariance(3.0).expect("a covariance");
    for (settled, left, part) in [(Limits::USUAL.settled, 0.02, 0.8), (Limits::ROUGH.settled, 1.0, 0.3)] {
        let (bundle, steps) = adjusted(settled);
        assert!(steps as f64 <= part * all as f64, "{steps} of {all}");
        for i in 1..19 {
            let [a, b] = [&bundle, &end].map(|bundle| &bundle.cameras[i].pose);
            let turned = a.angle_to(b) / deviations.rotation[i];
            let moved = a.center().distance(b.center()) / deviations.center[i];
            assert!(turned < left && moved < left, "{settled}, {i}: {turned}, {moved}");
        }
        let longer = (bundle.lenses[1].log_focal - end.lenses[1].log_focal).abs() / deviations.focal[1];
        assert!(longer < left, "{settled}: {longer}");
    }
}

/// The deviations of lenses among more cameras than a dense matrix is for.
#[test]
fn lenses_are_as_exact_among_many_cameras() {
    let bundle = chain(30, 400);
    let [dense, sparse] = [200, 0]
        .map(|dense| bundle.covariance_within(3.0, &Limits { dense, profile: 0, iterations: 5000, ..Limits::USUAL }));
    let (dense, sparse) = (dense.expect("a covariance"), sparse.expect("a covariance"));
    for (a, b) in dense.focal.iter().chain(&dense.k1).zip(sparse.focal.iter().chain(&sparse.k1)) {
        assert!((a / b - 1.0).abs() < 1e-4, "{a} and {b}");
    }
    // If all others are known, a camera is known better.
    assert!(dense.rotation.iter().zip(&sparse.rotation).all(|(a, b)| a > b));
}

/// The deviations of all cameras and lenses by a sparse factor, and by a dense one. The place of the world is
/// undetermined; or one camera is fixed, and its scale is undetermined; or everything is determined.
#[test]
fn cameras_among_many_are_as_exact_as_among_few() {
    for fixed in [&[][..], &[7], &[0, 29]] {
        let mut bundle = chain(30, 400);
        fixed.iter().for_each(|camera| bundle.fixed[*camera] = true);
        let [dense, sparse] = [(200, 0), (0, 100_000)].map(|(dense, profile)| {
            bundle.covariance_within(3.0, &Limits { dense, profile, ..Limits::USUAL }).expect("a covariance")
        });
        let of = |c: &Covariance| [&c.focal, &c.k1, &c.rotation, &c.center].map(Clone::clone).concat();
        for (a, b) in of(&dense).into_iter().zip(of(&sparse)) {
            assert!((a / b - 1.0).abs() < 1e-6 || a.is_nan() && b.is_nan(), "{fixed:?}: {a} and {b}");
        }
    }
}
