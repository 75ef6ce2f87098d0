//! The appearance expert: its gradients, invariances and refusals.

use proptest::prelude::*;
use weaver_autograd::gradcheck::{Input, Options, gradcheck_with};
use weaver_autograd::ops::{self, RopeTable};
use weaver_autograd::{Params, Tape, Var};
use weaver_nn::{Builder, Context, Projections, projective_attention};
use weaver_pose::{CameraVars, projections};
use weaver_two_experts::{OpacityDegree, Parametrization, Pyramid, PyramidConfig};

const SIZE: [usize; 2] = [8, 16];
const VIEWS: usize = 2;

fn config() -> PyramidConfig {
    PyramidConfig {
        patch: 2,
        width: 8,
        blocks: [1, 2, 2],
        head: 8,
        mlp_ratio: 2,
        registers: 1,
        group: 2,
        features: 8,
        cameras: true,
        world_rays: true,
        opacity: OpacityDegree::Two,
        gain: 1.0,
    }
}

fn network(config: PyramidConfig) -> (Params<f64>, Pyramid) {
    let mut params = Params::new();
    let network = Pyramid::new(Builder::new(&mut params, 1), config);
    (params, network)
}

/// Cameras that are turned a little and moved, as rows [R | t].
fn viewmats(seed: u64, views: usize) -> Vec<f64> {
    let codes = Input::uniform(seed, -0.3, 0.3, [views, 6]).data;
    let tape = Tape::<f64>::new();
    let code = |c: &[f64]| [c[0], c[1], c[2], c[3], c[4], c[5], 1.0, 1.0, 1.0];
    let codes: Vec<f64> = codes.chunks(6).flat_map(code).collect();
    weaver_pose::cameras(tape.constant(&codes, [views, 9]), 8, 8).viewmats.to_vec()
}

fn intrinsics(views: usize) -> Vec<f64> {
    [12.0, 11.0, 8.2, 3.9].repeat(views)
}

/// w2c times a rigid motion of the world.
fn moved(viewmats: &[f64], world: &[f64]) -> Vec<f64> {
    let entry = |e: &[f64], at: usize| {
        let (i, j) = (at / 4, at % 4);
        (0..3).map(|k| e[4 * i + k] * world[4 * k + j]).sum::<f64>() + if j == 3 { e[4 * i + 3] } else { 0.0 }
    };
    viewmats.chunks(12).flat_map(|e| (0..12).map(|at| entry(e, at)).collect::<Vec<_>>()).collect()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 64))]

    /// Gradients of means, colors and opacities by photos, poses and focal lengths, through rays, attention and
    /// directions.
    #[test]
    fn gradients_of_photos_and_cameras(seed in 0u64..1_000_000, published: bool) {
        let (params, network) = network(config());
        let inputs = [
            Input::uniform(seed, 0.0, 1.0, [VIEWS, 3, SIZE[0], SIZE[1]]),
            Input { data: viewmats(seed, VIEWS), ..Input::normal(seed, [VIEWS, 3, 4]) },
            Input { data: intrinsics(VIEWS), ..Input::normal(seed, [VIEWS, 4]) },
        ];
        let kind = if published { Parametrization::Published } else { Parametrization::Footprint { scale: 0.7 } };
        // Rectifiers have kinks: a few places, small steps.
        let options = Options { step: 1e-6, tolerance: 1e-4, coordinates: 3, directions: 1, ..Options::default() };
        gradcheck_with(options, &inputs, |x| {
            let cameras = CameraVars { viewmats: x[1], intrinsics: x[2] };
            let cx = Context::new(x[0].tape(), &params);
            let (raw, _) = network.forward(cx, x[0], &cameras);
            let (gaussians, depth) = raw.gaussians(kind, x[2], x[0]);
            let opacities = raw.opacities().seen_from(gaussians.means, raw.rays.origins.slice(0, 1, 1));
            vec![gaussians.means, gaussians.colors, gaussians.scales, opacities, depth]
        });
    }

    /// Attention sees relative poses of cameras alone.
    ///
    /// Promise (results): attention with cameras knows no world, and one camera is none.
    #[test]
    fn attention_knows_no_world(seed in 0u64..1_000_000) {
        let (views, tokens, heads, width) = (3, 2, 2, 16);
        let turns = RopeTable::new(&[[0, 0], [1, 2]].repeat(views), width / 2, 100.0);
        let tape = Tape::<f64>::new();
        let [q, k, v] = [1, 2, 3].map(|i| {
            let shape = [2, views * tokens, heads, width];
            tape.constant(&Input::normal(seed + i, shape).data, shape)
        });
        let attend = |rows: &[f64]| {
            let viewmats = tape.constant(rows, [2, views, 3, 4]);
            let intrinsics = tape.constant(&intrinsics(2 * views), [2, views, 4]);
            let [matrices, inverses] = projections(&CameraVars { viewmats, intrinsics }, SIZE);
            projective_attention(q, k, v, &Projections { matrices, inverses }, &turns).to_vec()
        };
        let cameras = viewmats(seed, 2 * views);
        let before = attend(&cameras);
        let world = viewmats(seed + 9, 1);
        prop_assert!(distance(&before, &attend(&moved(&cameras, &world))) < 1e-12);
        // Scaling the world is not one of these motions.
        let scaled: Vec<f64> = cameras.iter().enumerate().map(|(i, x)| if i % 4 == 3 { 3.0 * x } else { *x }).collect();
        prop_assert!(distance(&before, &attend(&scaled)) > 1e-6);
    }

    /// Equal cameras, wherever they stand, and positions 0: plain attention. The same holds within a single view.
    ///
    /// Promise of `attention_knows_no_world`.
    #[test]
    fn one_camera_is_none(seed in 0u64..1_000_000) {
        let (tokens, width) = (5, 8);
        let turns = RopeTable::new(&[[0, 0]; 5], width / 2, 100.0);
        let tape = Tape::<f64>::new();
        let shape = [1, tokens, 1, width];
        let [q, k, v] = [1, 2, 3].map(|i| tape.constant(&Input::normal(seed + i, shape).data, shape));
        for views in [1, 5] {
            let one = viewmats(seed, 1);
            let viewmats = tape.constant(&one.repeat(views), [1, views, 3, 4]);
            let intrinsics = tape.constant(&intrinsics(views), [1, views, 4]);
            let [matrices, inverses] = projections(&CameraVars { viewmats, intrinsics }, SIZE);
            let found = projective_attention(q, k, v, &Projections { matrices, inverses }, &turns).to_vec();
            let plain = ops::attention(q, k, v, 1.0 / (width as f64).sqrt()).to_vec();
            prop_assert!(distance(&found, &plain) < 1e-11, "{} views: {}", views, distance(&found, &plain));
        }
    }
}

/// Every parameter of every part is reached from the pictures.
#[test]
fn every_parameter_learns() {
    for opacity in [OpacityDegree::Constant, OpacityDegree::Two] {
        let (params, network) = network(PyramidConfig { opacity, ..config() });
        let tape = Tape::<f64>::new();
        let photos = Input::uniform(5, 0.0, 1.0, [VIEWS, 3, SIZE[0], SIZE[1]]);
        let photos = tape.constant(&photos.data, photos.shape);
        let cameras = CameraVars {
            viewmats: tape.constant(&viewmats(5, VIEWS), [VIEWS, 3, 4]),
            intrinsics: tape.constant(&intrinsics(VIEWS), [VIEWS, 4]),
        };
        let (raw, _) = network.forward(Context::new(&tape, &params), photos, &cameras);
        let (gaussians, _) = raw.gaussians(Parametrization::Footprint { scale: 0.7 }, cameras.intrinsics, photos);
        let opacities = raw.opacities().seen_from(gaussians.means, raw.rays.origins.slice(0, 0, 1));
        let all = [gaussians.means, gaussians.quats, gaussians.scales, gaussians.colors, opacities];
        let sums = all.map(|x| (x * x).sum());
        sums.into_iter().reduce(|a, b| a + b).unwrap().backward();
        for (id, param) in params.iter() {
            let gradient = tape.param_grad(id).unwrap_or_else(|| panic!("{} has no gradient", param.name()));
            assert!(gradient.iter().any(|g| *g != 0.0), "{}", param.name());
        }
    }
}

/// Without cameras in attention and in rays, moving a camera changes nothing; with either it does.
#[test]
fn switches_change_what_they_name() {
    let photos = Input::uniform(7, 0.0, 1.0, [VIEWS, 3, SIZE[0], SIZE[1]]);
    let out = |config: PyramidConfig, rows: &[f64]| {
        let (params, network) = network(config);
        let tape = Tape::<f64>::new();
        let cameras = CameraVars {
            viewmats: tape.constant(rows, [VIEWS, 3, 4]),
            intrinsics: tape.constant(&intrinsics(VIEWS), [VIEWS, 4]),
        };
        let photos = tape.constant(&photos.data, photos.shape);
        network.forward(Context::new(&tape, &params), photos, &cameras).0.raw.to_vec()
    };
    let [a, b] = [7, 8].map(|seed| viewmats(seed, VIEWS));
    let blind = PyramidConfig { cameras: false, world_rays: false, ..config() };
    assert_eq!(out(blind, &a), out(blind, &b));
    for cameras in [true, false] {
        let seeing = PyramidConfig { cameras, world_rays: !cameras, ..config() };
        assert!(distance(&out(seeing, &a), &out(seeing, &b)) > 1e-6, "cameras {cameras}");
    }
}

/// The same bits on one thread and on three.
#[test]
fn any_number_of_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let (params, network) = network(config());
            let tape = Tape::<f64>::new();
            let photos = Input::uniform(9, 0.0, 1.0, [4, 3, 16, 32]);
            let photos = tape.leaf(&photos.data, photos.shape);
            let cameras = CameraVars {
                viewmats: tape.constant(&viewmats(9, 4), [4, 3, 4]),
                intrinsics: tape.constant(&intrinsics(4), [4, 4]),
            };
            let (raw, _) = network.forward(Context::new(&tape, &params), photos, &cameras);
            raw.raw.sum().backward();
            (raw.raw.to_vec(), photos.grad())
        })
    };
    assert_eq!(run(1), run(3));
}

/// Sides that are no multiples of four patches, and view counts that are no multiple of the group, are refused with
/// both numbers.
#[test]
fn sizes_that_do_not_fit_are_refused() {
    for shape in [[2, 3, 12, 16], [3, 3, 8, 16]] {
        let refused = std::panic::catch_unwind(|| {
            let (params, network) = network(config());
            let tape = Tape::<f64>::new();
            let photos: Var<'_, f64> = tape.constant_with(shape, |_| ());
            let cameras = CameraVars {
                viewmats: tape.constant(&viewmats(1, shape[0]), [shape[0], 3, 4]),
                intrinsics: tape.constant(&intrinsics(shape[0]), [shape[0], 4]),
            };
            network.forward(Context::new(&tape, &params), photos, &cameras);
        });
        let message = refused.unwrap_err().downcast::<String>().unwrap();
        assert!(message.contains("photos [2 n, 3, 8 h, 8 w]"), "{message}");
    }
}
