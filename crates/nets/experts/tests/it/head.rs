//! The head put together: mechanisms that must hold for any numbers.

use weaver_autograd::{Params, Pool, Tape, Var};
use weaver_experts::{
    CardinalityHead, HeadConfig, NeighborConfig, NeighborFusion, Neighbors, Parametrization, PixelGaussians,
    PixelInputs, decode,
};
use weaver_kernels::random::Stream;
use weaver_nn::{Builder, Context};
use weaver_router::{Allocation, AllocationRequest, Fixed, Sampled, TrainingMix};
use weaver_splat::GaussianVars;

const SIZE: [usize; 3] = [2, 6, 5];
const PIXELS: usize = 60;

fn config(parametrization: Parametrization) -> HeadConfig {
    let neighbors = NeighborConfig { count: 8, projector: 4, width: 6, zero_head: false };
    HeadConfig {
        features: 7,
        router_hidden: 5,
        max_per_pixel: 3,
        sh_degree: 1,
        neighbors: Some(neighbors),
        expert_output_gain: 1.0,
        parametrization,
    }
}

fn normal(seed: u64, n: usize) -> Vec<f64> {
    let stream = Stream::new(seed, 0, "inputs");
    (0..n as u64).map(|i| stream.normal(i)).collect()
}

fn all<'t>(g: &GaussianVars<'t, f64>) -> [Var<'t, f64>; 5] {
    [g.means, g.scales, g.quats, g.opacities, g.colors]
}

struct Model {
    params: Params<f64>,
    head: CardinalityHead,
}

impl Model {
    fn new(config: HeadConfig) -> Self {
        let mut params = Params::new();
        let head = CardinalityHead::new(Builder::new(&mut params, 5).scope("gs_moe"), config);
        Self { params, head }
    }

    /// Logits and Gaussians under an allocation.
    fn run<'t>(
        &'t self,
        tape: &'t Tape<f64>,
        allocation: &dyn Allocation<f64>,
    ) -> (Var<'t, f64>, PixelGaussians<'t, f64>) {
        let cx = Context::new(tape, &self.params);
        let [views, height, width] = SIZE;
        let features = tape.leaf(&normal(1, PIXELS * 7), [PIXELS, 7]);
        let logits = self.head.router.forward(cx, features);
        let energy = [0.1; PIXELS];
        let assignment = {
            let logits = logits.value();
            let stream = Stream::new(9, 0, "router.gumbel");
            allocation.allocate(&AllocationRequest {
                logits: &logits,
                energy: &energy,
                photos: &[0.3; 3 * PIXELS],
                depth: None,
                views,
                height,
                width,
                stream,
                inside: None,
                gumbel: None,
                pool: tape.pool(),
            })
        };
        let pixels = PixelInputs {
            features,
            points: tape.leaf(&normal(2, PIXELS * 3), [PIXELS, 3]),
            footprints: Some(tape.leaf(&[0.05; PIXELS], [PIXELS])),
            colors: Some(tape.constant(&[0.3; PIXELS * 3], [PIXELS, 3])),
            height,
            width,
        };
        let gaussians = self.head.gaussians(cx, &pixels, &assignment, assignment.choice(logits, 0.5));
        (logits, gaussians)
    }

    /// The gradients of all parameters by name, of the sum of squares of all outputs.
    fn gradients(&self, allocation: &dyn Allocation<f64>) -> Vec<(String, Option<Vec<f64>>)> {
        let tape = Tape::new();
        let (_, predicted) = self.run(&tape, allocation);
        let squares = all(&predicted.gaussians).map(|x| (x * x).sum());
        squares.into_iter().reduce(|a, b| a + b).unwrap().backward();
        let grad = |id| tape.param_grad(id).map(|g| g.to_vec());
        self.params.iter().map(|(id, p)| (p.name().to_owned(), grad(id))).collect()
    }
}

#[test]
fn shapes_and_ranges() {
    for parametrization in [Parametrization::published(), Parametrization::footprint(), Parametrization::patch()] {
        let model = Model::new(config(parametrization));
        let tape = Tape::new();
        let (_, PixelGaussians { gaussians: g, pixel }) = model.run(&tape, &Fixed { expert: 3 });
        let n = 3 * PIXELS;
        assert_eq!(pixel.len(), n);
        let shapes = all(&g).map(|v| v.shape());
        assert_eq!(shapes, [[n, 3].into(), [n, 3].into(), [n, 4].into(), [n].into(), [n, 4, 3].into()]);
        assert!(g.opacities.to_vec().iter().all(|o| (0.0..=1.0).contains(o)));
        assert!(g.scales.to_vec().iter().all(|&s| s > 0.0 && s <= 0.4));
        for q in g.quats.to_vec().chunks(4) {
            assert!((q.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-6);
        }
        let points = normal(2, PIXELS * 3);
        let reach = match parametrization {
            Parametrization::Published { .. } => 0.005,
            Parametrization::Footprint { .. } => 0.1,
            // Two extents, of at most three footprints, in any direction.
            Parametrization::Patch { .. } => 0.3 * 3.0_f64.sqrt(),
        };
        for (mean, &pixel) in g.means.to_vec().chunks(3).zip(pixel.iter()) {
            let point = &points[3 * pixel as usize..];
            assert!((0..3).all(|a| (mean[a] - point[a]).abs() <= reach));
        }
    }
}

#[test]
fn the_harmonics_are_damped_by_degree() {
    let tape = Tape::<f64>::new();
    let theta = tape.constant(&[1.0; 8 + 27], [1, 35]);
    let means = tape.constant(&[0.0; 3], [1, 3]);
    let sh = decode(means, theta, 2, None, Parametrization::published()).colors.to_vec();
    let degree = [1.0, 0.025, 0.025, 0.025, 0.00625, 0.00625, 0.00625, 0.00625, 0.00625];
    for (rgb, factor) in sh.chunks(3).zip(degree) {
        assert!(rgb.iter().all(|x| (x - factor).abs() < 1e-15));
    }
}

#[test]
fn no_gaussians_at_all() {
    for parametrization in [Parametrization::published(), Parametrization::footprint(), Parametrization::patch()] {
        let model = Model::new(config(parametrization));
        let tape = Tape::new();
        let (_, PixelGaussians { gaussians: g, pixel }) = model.run(&tape, &Fixed { expert: 0 });
        assert!(pixel.is_empty() && g.means.to_vec().is_empty() && g.colors.to_vec().is_empty());
        for (name, grad) in model.gradients(&Fixed { expert: 0 }) {
            if !name.contains("gating") {
                assert!(grad.expect(&name).iter().all(|&g| g == 0.0), "{name}");
            }
        }
    }
}

/// Every parameter is reached and the router only by its own choices.
#[test]
fn gradients_reach_every_parameter() {
    let model = Model::new(config(Parametrization::footprint()));
    let router = |name: &str| name.starts_with("gs_moe.gating.");
    let unused = |name: &str| name.starts_with("gs_moe.experts.2") || name.starts_with("gs_moe.experts.3");
    // A softmax over neighbors does not see this bias.
    let blind = |name: &str| name.ends_with("attn_mlp.2.bias");
    for (name, grad) in model.gradients(&Sampled) {
        let grad = grad.expect(&name);
        assert!(blind(&name) || grad.iter().any(|&g| g != 0.0), "{name} is not trained by sampling");
    }
    for (name, grad) in model.gradients(&TrainingMix::default()) {
        if router(&name) {
            assert!(grad.is_none(), "{name}");
        } else {
            let zero = grad.expect(&name).iter().all(|&g| g == 0.0);
            assert!(blind(&name) || zero == unused(&name), "{name}: zero gradient {zero}");
        }
    }
}

/// Without neighbors and with a zero head the parameters are the experts.
#[test]
fn a_zero_head_leaves_the_experts() {
    let loud = config(Parametrization::footprint());
    let quiet = NeighborConfig { zero_head: true, ..loud.neighbors.unwrap() };
    let models =
        [HeadConfig { neighbors: Some(quiet), ..loud }, HeadConfig { neighbors: None, ..loud }].map(Model::new);
    assert!(models[1].params.iter().all(|(_, p)| !p.name().contains("gs_predictor")));
    let tapes = [Tape::new(), Tape::new()];
    let [a, b] = [0, 1].map(|i| models[i].run(&tapes[i], &Fixed { expert: 2 }).1.gaussians);
    assert_eq!(a.colors.to_vec(), b.colors.to_vec());
    assert_eq!(a.scales.to_vec(), b.scales.to_vec());
}

/// A footprint start is upright and in the color of its pixel.
#[test]
fn footprints_start_upright_in_their_color() {
    let config = HeadConfig { expert_output_gain: 0.0, neighbors: None, ..config(Parametrization::footprint()) };
    let model = Model::new(config);
    let tape = Tape::new();
    let g = model.run(&tape, &Fixed { expert: 1 }).1.gaussians;
    for (quat, sh) in g.quats.to_vec().chunks(4).zip(g.colors.to_vec().chunks(12)) {
        assert!((quat[0] - 1.0).abs() < 1e-7 && quat[1..].iter().all(|&x| x == 0.0));
        let dc = (0.3 - 0.5) / 0.282_094_79;
        assert!(sh[..3].iter().all(|x| (x - dc).abs() < 1e-7) && sh[3..].iter().all(|&x| x == 0.0));
    }
    // One Gaussian per pixel everywhere: the local count is 1.
    assert!(g.scales.to_vec().iter().all(|s| (s - 0.7 * 0.05).abs() < 1e-15));
    assert_eq!(g.opacities.to_vec(), [0.5; PIXELS]);
}

#[test]
fn fusion_does_not_depend_on_the_order_of_gaussians() {
    let mut params = Params::<f64>::new();
    let fusion = NeighborFusion::new(Builder::new(&mut params, 1), 5);
    for n in [1, 2, 5, 8, 9, 40] {
        let (x, means) = (normal(3, n * 5), normal(4, n * 3));
        let tape = Tape::new();
        let run = |x: &[f64], means: &[f64]| {
            let neighbors = Neighbors::search(means, 8, &Pool::new());
            let (x, means) = (tape.constant(x, [n, 5]), tape.constant(means, [n, 3]));
            fusion.forward(Context::new(&tape, &params), x, means, &neighbors).to_vec()
        };
        let order = Stream::new(7, 0, "order").permutation(n);
        let reordered = |v: &[f64], width: usize| -> Vec<f64> {
            order.iter().flat_map(|&i| v[i * width..(i + 1) * width].to_vec()).collect()
        };
        let plain = reordered(&run(&x, &means), 5);
        let moved = run(&reordered(&x, 5), &reordered(&means, 3));
        assert!(plain.iter().zip(&moved).all(|(a, b)| (a - b).abs() < 1e-12), "{n} Gaussians");
    }
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    let model = Model::new(config(Parametrization::footprint()));
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| model.gradients(&Sampled))
    };
    let bits = |gradients: Vec<(String, Option<Vec<f64>>)>| -> Vec<u64> {
        gradients.into_iter().flat_map(|(_, g)| g.unwrap()).map(f64::to_bits).collect()
    };
    let one = bits(on(1));
    assert_eq!(one, bits(on(2)));
    assert_eq!(one, bits(on(5)));
}

#[test]
fn a_repeated_step_takes_no_new_memory_from_the_pool() {
    let model = Model::new(config(Parametrization::footprint()));
    let mut tape = Tape::new();
    let mut step = || {
        let (_, predicted) = model.run(&tape, &Sampled);
        let sums = all(&predicted.gaussians).map(|x| x.sum());
        sums.into_iter().reduce(|a, b| a + b).unwrap().backward();
        drop(predicted);
        tape.reset();
        tape.pool().allocated_bytes()
    };
    step();
    let second = step();
    assert_eq!(step(), second);
}

/// Recorded, all Gaussians attend at once; without a record some at a time.
#[test]
fn attending_in_parts_gives_the_same_bits() {
    const N: usize = 20_001;
    const WIDTH: usize = 32;
    let mut params = Params::<f32>::new();
    let fusion = NeighborFusion::new(Builder::new(&mut params, 3), WIDTH);
    let stream = Stream::new(4, 0, "inputs");
    let numbers = |n: usize| -> Vec<f32> { (0..n as u64).map(|i| stream.normal(i)).collect() };
    let run = |tape: &Tape<f32>| {
        let (x, means) = (tape.leaf(&numbers(N * WIDTH), [N, WIDTH]), tape.leaf(&numbers(N * 3), [N, 3]));
        let neighbors = Neighbors::search(&means.value(), 8, tape.pool());
        fusion.forward(Context::new(tape, &params), x, means, &neighbors).to_vec()
    };
    let (whole, parts) = (Tape::new(), Tape::new());
    let at_once = run(&whole);
    let in_parts = parts.without_gradient(|| run(&parts));
    assert!(at_once.iter().zip(&in_parts).all(|(a, b)| a.to_bits() == b.to_bits()));
    assert!(at_once.iter().all(|z| z.is_finite()) && at_once.len() == N * WIDTH);
    assert!(2 * parts.pool().peak_bytes() < whole.pool().peak_bytes());
}
