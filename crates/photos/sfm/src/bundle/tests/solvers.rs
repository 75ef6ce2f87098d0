//! The solvers of the reduced equations beside each other, on problems without any order.

use super::*;

/// Cameras around points, each of which a random set of cameras sees, with noise.
fn tangle(seed: u64) -> Bundle {
    let stream = Stream::new(seed, 0, "test.tangle");
    let draw = |k: usize| DVec3::new(stream.normal(k as u64), stream.normal(k as u64 + 1), stream.normal(k as u64 + 2));
    let cameras = 4 + stream.below(0, 20);
    let intrinsics = Intrinsics { fx: 300.0, fy: 300.0, cx: 160.0, cy: 120.0 };
    let camera = |i: usize| {
        let turn = so3::exp(draw(10 + 3 * i) * 0.1) * so3::exp(DVec3::Y * (6.2 * i as f64 / cameras as f64));
        Camera { pose: Pose::new(turn, DVec3::Z * 5.0), intrinsics, width: 320, height: 240 }
    };
    let lens = Lens { free_focal: true, free_k1: seed.is_multiple_of(2), ..Lens::default() };
    let mut bundle = Bundle {
        cameras: (0..cameras).map(camera).collect(),
        lenses: vec![lens; 3],
        lens_of: (0..cameras).map(|i| i % 3).collect(),
        fixed: (0..cameras).map(|i| i < 2).collect(),
        points: (0..150).map(|i| draw(1000 + 100 * i) * 0.5).collect(),
        ..Bundle::default()
    };
    for point in 0..bundle.points.len() {
        let seen = 2 + stream.below(5000 + point as u64, 4.min(cameras - 2));
        let mut seeing = stream.fork(point as u64).permutation(cameras);
        seeing.truncate(seen);
        for camera in seeing {
            let of = &bundle.cameras[camera];
            let noise = draw(1003 + 100 * point + 3 * camera).truncate();
            let pixel = lens.project(of, of.pose.apply(bundle.points[point])) + noise;
            bundle.observations.push(Observation { camera, point, pixel, deviation: 1.0 });
        }
    }
    bundle
}

/// The factors of a dense and of a sparse matrix and conjugate gradients, whatever sees whatever.
#[test]
fn all_solvers_take_the_same_step() {
    for seed in 0..16 {
        let bundle = tangle(seed);
        let step = |dense: usize, profile: usize| {
            let limits = Limits { dense, profile, tolerance: 1e-14, iterations: 2000, ..Limits::USUAL };
            let mut descent = Descent::new(&bundle, 3.0, &limits);
            descent.linearize();
            assert!(descent.solve(1e-3), "{seed}");
            descent.step.clone()
        };
        let dense = step(1000, 0);
        let largest = dense.as_flattened().iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        assert!(largest > 1e-4, "{seed}");
        for (name, other) in [("profile", step(0, 1_000_000)), ("conjugate gradients", step(0, 0))] {
            let apart = dense.as_flattened().iter().zip(other.as_flattened()).map(|(a, b)| (a - b).abs());
            let apart = apart.fold(0.0, f64::max);
            assert!(apart < 1e-9 * largest, "{seed}, {name}: {apart} apart of {largest}");
        }
    }
}
