use proptest::prelude::*;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::{Intrinsics, Pose};
use weaver_pose::plane_sweep;

/// Cameras that look at one place from near each other, and depths about right.
struct Scene {
    poses: Vec<Pose>,
    intrinsics: Vec<Intrinsics>,
    depth: Vec<f64>,
    size: [usize; 3],
}

impl Scene {
    fn new(seed: u64, [views, h, w]: [usize; 3]) -> Self {
        let numbers = Input::uniform(seed, -1.0, 1.0, [views, 10]).data;
        let pose = |n: &[f64]| {
            let q = [1.0, 0.05 * n[0], 0.05 * n[1], 0.1 * n[2]];
            Pose::from_wxyz(q, DVec3::new(0.3 * n[3], 0.3 * n[4], 0.1 * n[5]))
        };
        let lens = |n: &[f64]| Intrinsics {
            fx: w as f64 * (1.0 + 0.2 * n[6]),
            fy: w as f64 * (1.0 + 0.2 * n[7]),
            cx: w as f64 * (0.5 + 0.1 * n[8]),
            cy: h as f64 * (0.5 + 0.1 * n[9]),
        };
        Self {
            poses: numbers.chunks(10).map(pose).collect(),
            intrinsics: numbers.chunks(10).map(lens).collect(),
            depth: Input::uniform(seed + 1, 1.5, 2.5, [views * h * w]).data,
            size: [views, h, w],
        }
    }

    fn viewmats(&self) -> Vec<f64> {
        self.poses.iter().flat_map(|pose| pose.rows().concat()).collect()
    }

    fn lenses(&self) -> Vec<f64> {
        self.intrinsics.iter().flat_map(|k| [k.fx, k.fy, k.cx, k.cy]).collect()
    }

    /// One number of the result by its definition.
    fn agreement(&self, features: &[f64], channels: usize, pixel: usize, factor: f64, offset: f64) -> f64 {
        let [views, h, w] = self.size;
        let (view, row, column) = (pixel / (h * w), pixel / w % h, pixel % w);
        let at = DVec2::new(column as f64 + offset, row as f64 + offset);
        let point = self.poses[view].inverse().apply(self.intrinsics[view].unproject(at, factor * self.depth[pixel]));
        let feature = |v: usize, r: usize, c: usize, i: usize| features[((v * h + r) * w + c) * channels + i];
        let mut products = vec![];
        for other in (0..views).filter(|&other| other != view) {
            let seen = self.poses[other].apply(point);
            let place = self.intrinsics[other].project(seen);
            let inside = (0.0..w as f64).contains(&place.x) && (0.0..h as f64).contains(&place.y);
            if seen.z <= 1e-3 * self.depth[pixel] || !inside {
                continue;
            }
            let x = (place.x - offset).clamp(0.0, (w - 1) as f64);
            let y = (place.y - offset).clamp(0.0, (h - 1) as f64);
            let mut product = 0.0;
            for r in 0..h {
                for c in 0..w {
                    // The tent of each pixel: bilinear interpolation.
                    let weight = (1.0 - (x - c as f64).abs()).max(0.0) * (1.0 - (y - r as f64).abs()).max(0.0);
                    let dot: f64 = (0..channels).map(|i| feature(view, row, column, i) * feature(other, r, c, i)).sum();
                    product += weight * dot;
                }
            }
            products.push(product / (channels as f64).sqrt());
        }
        products.iter().sum::<f64>() / products.len().max(1) as f64
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 20))]

    #[test]
    fn gradients(seed in 0u64..1_000_000, v in 1usize..4, h in 1usize..4, w in 1usize..4, c in 1usize..4, centered: bool) {
        let offset = if centered { 0.5 } else { 0.0 };
        let scene = Scene::new(seed, [v, h, w]);
        let inputs = [
            Input::normal(seed, [v, h, w, c]),
            Input { data: scene.depth.clone(), ..Input::normal(0, [v, h, w]) }.constant(),
            Input { data: scene.viewmats(), ..Input::normal(0, [v, 3, 4]) }.constant(),
            Input { data: scene.lenses(), ..Input::normal(0, [v, 4]) }.constant(),
        ];
        gradcheck(&inputs, |x| vec![plane_sweep(x[0], x[1], x[2], x[3], &[0.7, 1.0, 1.4], offset)]);
    }

    #[test]
    fn is_its_definition(seed in 0u64..1_000_000, v in 1usize..4, h in 1usize..6, w in 1usize..6, centered: bool) {
        let (c, offset, factors) = (3, if centered { 0.5 } else { 0.0 }, [0.6, 1.0, 1.1, 3.0]);
        let scene = Scene::new(seed, [v, h, w]);
        let features = Input::normal(seed + 2, [v, h, w, c]).data;
        let tape = Tape::<f64>::new();
        let found = plane_sweep(
            tape.constant(&features, [v, h, w, c]),
            tape.constant(&scene.depth, [v, h, w]),
            tape.constant(&scene.viewmats(), [v, 3, 4]),
            tape.constant(&scene.lenses(), [v, 4]),
            &factors,
            offset,
        );
        for (i, found) in found.to_vec().into_iter().enumerate() {
            let expected = scene.agreement(&features, c, i / 4, factors[i % 4], offset);
            prop_assert!((found - expected).abs() < 1e-9, "{i}: {found}, not {expected}");
        }
    }
}

/// Points nearer to the other camera than a thousandth of the depth are not seen; depth and cameras get no gradient.
#[test]
fn what_is_too_near_is_not_seen() {
    for (in_front, seen) in [(0.001, 0.0), (0.003, 1.0)] {
        let tape = Tape::<f64>::new();
        let features = tape.leaf(&[1.0, 1.0], [2, 1, 1, 1]);
        let depth = tape.leaf(&[2.0, 2.0], [2, 1, 1]);
        let row = |i: usize, t: f64| std::array::from_fn::<f64, 4, _>(|j| if j == 3 { t } else { f64::from(i == j) });
        let along = |z: f64| [row(0, 0.0), row(1, 0.0), row(2, z)].concat();
        let viewmats = tape.leaf(&[along(0.0), along(in_front - 2.0)].concat(), [2, 3, 4]);
        let lenses = tape.leaf(&[1.0, 1.0, 0.5, 0.5].repeat(2), [2, 4]);
        let found = plane_sweep(features, depth, viewmats, lenses, &[1.0], 0.5);
        found.sum().backward();
        assert!((found.to_vec()[0] - seen).abs() < 1e-12, "{in_front}: {:?}", found.to_vec());
        assert!([depth, viewmats, lenses].iter().all(|x| x.grad().is_none()));
    }
}

/// The same bits on one thread and on four, gradient included.
#[test]
fn any_number_of_threads() {
    let scene = Scene::new(3, [3, 7, 9]);
    let features: Vec<f32> = Input::normal(4, [3, 7, 9, 4]).data.iter().map(|x| *x as f32).collect();
    let narrow = |x: Vec<f64>| x.into_iter().map(|x| x as f32).collect::<Vec<f32>>();
    let run = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let tape = Tape::new();
            let features = tape.leaf(&features, [3, 7, 9, 4]);
            let found = plane_sweep(
                features,
                tape.constant(&narrow(scene.depth.clone()), [3, 7, 9]),
                tape.constant(&narrow(scene.viewmats()), [3, 3, 4]),
                tape.constant(&narrow(scene.lenses()), [3, 4]),
                &[0.9, 1.0, 1.1],
                0.5,
            );
            (found * found).sum().backward();
            (found.to_vec(), features.grad().unwrap().to_vec())
        })
    };
    assert_eq!(run(1), run(4));
}
