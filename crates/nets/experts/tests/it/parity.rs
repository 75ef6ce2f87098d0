//! Parity with the official head: every stage after the pixel features, values and gradients.

use crate::layouts::{to_rows, transpose_each, w_first};
use weaver_autograd::{Params, Pool, Tape, Var};
use weaver_experts::{
    CardinalityHead, HeadConfig, NeighborConfig, NeighborPredictor, Neighbors, Parametrization, PixelInputs, decode,
};
use weaver_fixtures::{Fixture, gradient_statistics};
use weaver_kernels::random::Stream;
use weaver_nn::{Builder, Context};
use weaver_router::{Allocation, AllocationRequest, Sampled};
use weaver_splat::GaussianVars;

const FILE: &str = "splatweaver_head_micro.safetensors";
const PATH: &str = "gaussian_param_head.gs_moe";
const VIEWS: usize = 2;
const HEIGHT: usize = 28;
const WIDTH: usize = 14;
const PIXELS: usize = VIEWS * HEIGHT * WIDTH;
const CHANNELS: usize = 8;

const CONFIG: HeadConfig = HeadConfig {
    features: CHANNELS,
    router_hidden: 12,
    max_per_pixel: 3,
    sh_degree: 2,
    neighbors: Some(NeighborConfig { count: 8, projector: 8, width: 12, zero_head: false }),
    expert_output_gain: 1.0,
    parametrization: Parametrization::Published { offset_reach: 0.005, scale_multiplier: 0.001, scale_max: 0.4 },
};

/// The cotangents in this crate's layouts: means, scales, quaternions wxyz, opacities, harmonics [N, K, 3].
fn cotangents(file: &Fixture) -> [Vec<f32>; 5] {
    let sh = file.f32("cot.sh");
    [
        file.f32("cot.means"),
        file.f32("cot.scales"),
        w_first(&file.f32("cot.quats")),
        file.f32("cot.opacities"),
        transpose_each(&sh, sh.len() / 27, 3),
    ]
}

fn weighted_sum<'t>(g: &GaussianVars<'t, f32>, cotangents: &[Vec<f32>; 5]) -> Var<'t, f32> {
    let outputs = [g.means, g.scales, g.quats, g.opacities, g.colors];
    let terms = outputs.into_iter().zip(cotangents).map(|(y, c)| (y * y.tape().constant(c, y.shape())).sum());
    terms.reduce(|a, b| a + b).unwrap()
}

fn assert_decoded(file: &Fixture, prefix: &str, g: &GaussianVars<'_, f32>) {
    file.assert_close(&format!("{prefix}.scales"), &g.scales.to_vec());
    let quats: Vec<f32> = g.quats.to_vec().chunks(4).flat_map(|q| [q[1], q[2], q[3], q[0]]).collect();
    file.assert_close(&format!("{prefix}.quats"), &quats);
    file.assert_close(&format!("{prefix}.opacities"), &g.opacities.to_vec());
    let n = g.colors.shape()[0];
    file.assert_close(&format!("{prefix}.sh"), &transpose_each(&g.colors.to_vec(), n, 9));
}

#[test]
fn the_whole_head_and_all_its_gradients() {
    let file = Fixture::open(FILE);
    let mut params = Params::new();
    let head = CardinalityHead::new(Builder::new(&mut params, 0).scope(PATH), CONFIG);
    file.load(&mut params);

    let tape = Tape::new();
    let cx = Context::new(&tape, &params);
    let rows = |key: &str| tape.leaf(&to_rows(&file.f32(key), VIEWS, CHANNELS), [PIXELS, CHANNELS]);
    let (features, router_features) = (rows("out.F"), rows("out.F_router"));
    let logits = head.router.forward(cx, router_features).retain_grad();
    let to_planes = |rows: &[f32]| transpose_each(rows, VIEWS, HEIGHT * WIDTH);
    file.assert_close("out.logits", &to_planes(&logits.to_vec()));

    let gumbel = file.f32("in.gumbel");
    let assignment = Sampled.allocate(&AllocationRequest {
        logits: &logits.to_vec(),
        energy: &[],
        photos: &[],
        depth: None,
        views: VIEWS,
        height: HEIGHT,
        width: WIDTH,
        stream: Stream::new(0, 0, "unused"),
        inside: None,
        gumbel: Some(&gumbel),
        pool: tape.pool(),
    });
    let assigned: Vec<u32> = assignment.expert.iter().map(|&e| u32::from(e)).collect();
    assert_eq!(assigned, file.indices("out.assigned"));

    let points = tape.leaf(&file.f32("in.points"), [PIXELS, 3]);
    let pixels = PixelInputs { features, points, footprints: None, colors: None, height: HEIGHT, width: WIDTH };
    let predicted = head.gaussians(cx, &pixels, &assignment, assignment.choice(logits, 0.5));
    let g = &predicted.gaussians;
    assert_eq!(*predicted.pixel, file.indices("out.gaussian_pixel"));
    file.assert_close("out.means", &g.means.to_vec());
    assert_decoded(&file, "out", g);

    let loss = weighted_sum(g, &cotangents(&file));
    file.assert_close("out.loss", &[loss.item()]);
    loss.backward();
    file.assert_close("grad.in.points", &points.grad().unwrap());
    file.assert_close("grad.stage.logits", &to_planes(&logits.grad().unwrap()));
    // The router's features are the experts' plus a term of their own, so both gradients meet in the latter.
    let (direct, routed) = (features.grad().unwrap(), router_features.grad().unwrap());
    let sum: Vec<f32> = direct.iter().zip(&routed).map(|(a, b)| a + b).collect();
    file.assert_close("grad.stage.F", &to_planes(&sum));

    for (id, param) in params.iter() {
        let grad = tape.param_grad(id).unwrap_or_else(|| panic!("{}", param.name())).to_vec();
        let key = format!("grad.w.{}", param.name());
        if let Some(left) = file.exact_zero(&key) {
            assert!(grad.iter().all(|g| f64::from(g.abs()) < 20.0 * left), "{key}: {grad:?}");
            continue;
        }
        if file.has(&key) {
            file.assert_close(&key, &grad);
        }
        // Norm, sum, and a weighted sum of every gradient, against the norm.
        let statistics = gradient_statistics(&grad);
        let expected = file.f64(&format!("gradstat.w.{}", param.name()));
        for (found, expected) in statistics.iter().zip(expected) {
            let allowed = 20.0 * file.gradient_error() * expected.abs().max(statistics[0]);
            assert!((found - expected).abs() <= allowed, "{key}: {found} against {expected}");
        }
    }
}

#[test]
fn neighbors_attention_and_refinement() {
    let file = Fixture::open(FILE);
    let mut params = Params::new();
    let path = format!("{PATH}.gs_predictor");
    let predictor = NeighborPredictor::new(Builder::new(&mut params, 0).scope(path), 35, 8, 12, false);
    file.load(&mut params);
    let tape = Tape::new();
    let cx = Context::new(&tape, &params);
    let slots = file.f32("out.slots");
    let n = slots.len() / 46;
    let x = tape.constant(&slots, [n, 46]);
    let (means, raw, feature) = (x.slice(1, 0, 3), x.slice(1, 3, 35), x.slice(1, 38, 8));

    let neighbors = Neighbors::search(&means.to_vec(), 8, &Pool::new());
    for (found, expected) in neighbors.index().chunks(9).zip(file.indices("out.knn").chunks(9)) {
        let sorted = |row: &[u32]| {
            let mut row = row.to_vec();
            row.sort_unstable();
            row
        };
        assert_eq!((found[0], sorted(found)), (expected[0], sorted(expected)));
    }
    file.assert_close("out.pt", &predictor.attend(cx, means, raw, feature, &neighbors).to_vec());
    file.assert_close("out.theta", &predictor.forward(cx, means, raw, feature, &neighbors).to_vec());
}

#[test]
fn decoding_and_its_gradient() {
    let file = Fixture::open(FILE);
    let tape = Tape::new();
    let theta = file.f32("out.theta");
    let theta = tape.leaf(&theta, [theta.len() / 35, 35]);
    let means = tape.constant(&file.f32("out.means"), [theta.shape()[0], 3]);
    let g = decode(means, theta, 2, None, CONFIG.parametrization);
    assert_decoded(&file, "out", &g);
    weighted_sum(&g, &cotangents(&file)).backward();
    file.assert_close("grad.stage.theta", &theta.grad().unwrap());
}

#[test]
fn decoding_at_the_edges() {
    let file = Fixture::open(FILE);
    let tape = Tape::new();
    let theta = tape.constant(&file.f32("edge.theta"), [12, 35]);
    let means = tape.constant(&[0.0; 36], [12, 3]);
    let g = decode(means, theta, 2, None, CONFIG.parametrization);
    assert_decoded(&file, "edge", &g);
    assert_eq!(g.scales.shape()[0], 12);
}
