//! Every op against finite differences.

use proptest::prelude::*;
use weaver_autograd::gradcheck::{Input, adjoint_check, gradcheck};
use weaver_autograd::{Pool, Tape, Var};
use weaver_experts::{
    Neighbors, Origin, Parametrization, PatchOf, PixelLists, PixelOf, decode, neighbor_average, neighbor_offset,
    neighbor_relation, patch_mean, place, slot_width,
};
use weaver_kernels::random::Stream;

fn some_neighbors(n: usize, m: usize, seed: u64) -> Neighbors {
    let stream = Stream::new(seed, 0, "lists");
    let lists: Vec<u32> = (0..(n * m) as u64).map(|i| stream.below(i, n) as u32).collect();
    Neighbors::from_lists(&lists, m, &Pool::new())
}

fn parametrizations() -> impl Strategy<Value = Parametrization> {
    let published = Parametrization::Published { offset_reach: 0.3, scale_multiplier: 0.2, scale_max: 100.0 };
    prop_oneof![Just(published), Just(Parametrization::footprint()), Just(Parametrization::patch())]
}

/// The inputs that Gaussians' raw numbers are relative to.
fn origin_inputs(parametrization: Parametrization, n: usize, seed: u64) -> Vec<Input> {
    let color = Input::uniform(seed + 3, 0.0, 1.0, [n, 3]).constant();
    match parametrization {
        Parametrization::Published { .. } => vec![],
        Parametrization::Footprint { .. } => {
            let local_count = Input::uniform(seed + 2, 0.04, 1.0, [n]).constant();
            vec![Input::uniform(seed + 1, 0.1, 2.0, [n]), local_count, color]
        }
        Parametrization::Patch { .. } => {
            let mut rotation = Input::normal(seed + 2, [n, 4]).constant();
            for q in rotation.data.chunks_mut(4) {
                let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
                q.iter_mut().for_each(|x| *x /= norm);
            }
            vec![Input::uniform(seed + 1, 0.1, 2.0, [n, 3]).constant(), rotation, color]
        }
    }
}

fn origin<'t>(parametrization: Parametrization, x: &[Var<'t, f64>]) -> Option<Origin<'t, f64>> {
    match parametrization {
        Parametrization::Published { .. } => None,
        Parametrization::Footprint { .. } => {
            Some(Origin::Pixel(PixelOf { footprint: x[0], local_count: x[1], color: x[2] }))
        }
        Parametrization::Patch { .. } => Some(Origin::Patch(PatchOf { extents: x[0], rotation: x[1], color: x[2] })),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 20))]

    #[test]
    fn neighbor_ops(n in 0..7usize, m in 1..5usize, c in 1..4usize, cut in 0..3usize, seed in 0..1000u64) {
        // Lists of all Gaussians, or of some in the middle.
        let lists = some_neighbors(n, m, seed).part(cut.min(n)..n.saturating_sub(cut).max(cut.min(n)));
        adjoint_check([n, 3], seed, |x| neighbor_offset(x, &lists));
        gradcheck(&[Input::normal(seed, [n, 3])], |x| vec![neighbor_offset(x[0], &lists)]);
        let rows = [lists.len() * m, c];
        let inputs = [Input::normal(seed, [n, c]), Input::normal(seed + 1, [n, c]), Input::normal(seed + 2, rows)];
        gradcheck(&inputs, |x| vec![neighbor_relation(x[0], x[1], x[2], &lists)]);
        let inputs = [Input::normal(seed, rows), Input::normal(seed + 1, [n, c]), Input::normal(seed + 2, rows)];
        gradcheck(&inputs, |x| vec![neighbor_average(x[0], x[1], x[2], &lists)]);
    }

    #[test]
    fn placing(n in 0..6usize, more in 0..3usize, parametrization in parametrizations(), seed in 0..1000u64) {
        let mut inputs = vec![Input::normal(seed, [n, 3]), Input::normal(seed + 1, [n, 3 + more])];
        inputs.extend(origin_inputs(parametrization, n, seed + 2));
        gradcheck(&inputs, |x| vec![place(x[0], x[1], origin(parametrization, &x[2..]), parametrization)]);
    }

    #[test]
    fn means_of_patches(p in 1..8usize, c in 1..4usize, lists in prop::collection::vec(1..5usize, 0..5), seed in 0..1000u64) {
        let stream = Stream::new(seed, 0, "lists");
        let list = |g: usize, len: usize| (0..len).map(|i| stream.below((8 * g + i) as u64, p) as u32).collect();
        let lists: Vec<Vec<u32>> = lists.into_iter().enumerate().map(|(g, len)| list(g, len)).collect();
        let lists = PixelLists::from_lists(&lists, &Pool::new());
        gradcheck(&[Input::normal(seed, [p, c])], |x| vec![patch_mean(x[0], &lists)]);
        adjoint_check([p, c], seed, |x| patch_mean(x, &lists));
    }

    #[test]
    fn decoding(n in 0..5usize, degree in 0..3usize, parametrization in parametrizations(), seed in 0..1000u64) {
        // Raw scales within the bounds: at a bound there is no derivative.
        let mut inputs = vec![Input::uniform(seed, -2.5, 2.5, [n, slot_width(degree) - 3])];
        inputs.extend(origin_inputs(parametrization, n, seed));
        gradcheck(&inputs, |x| {
            let origin = origin(parametrization, &x[1..]);
            let means = x[0].tape().constant(&vec![0.0; 3 * n], [n, 3]);
            let d = decode(means, x[0], degree, origin, parametrization);
            vec![d.scales, d.quats, d.opacities, d.colors]
        });
    }
}

#[test]
fn clamped_scales_have_no_gradient_and_bounds_pass_it() {
    let tape = Tape::<f64>::new();
    let theta = |s: [f64; 3]| tape.leaf(&[&[0.0], &s[..], &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]].concat(), [1, 11]);
    let published = theta([10.0, 0.0, -50.0]);
    let means = tape.constant(&[0.0; 3], [1, 3]);
    let capped = Parametrization::Published { offset_reach: 0.0, scale_multiplier: 0.1, scale_max: 0.4 };
    let d = decode(means, published, 0, None, capped);
    assert_eq!(d.scales.to_vec()[0], 0.4);
    d.scales.sum().backward();
    let grad = published.grad().unwrap();
    assert!(grad[1] == 0.0 && (grad[2] - 0.05).abs() < 1e-15 && grad[3] > 0.0);

    let footprint = theta([-4.0, 3.0, 3.5]);
    let one = tape.constant(&[1.0], [1]);
    let pixel = PixelOf { footprint: one, local_count: one, color: tape.constant(&[0.5; 3], [1, 3]) };
    let d = decode(means, footprint, 0, Some(Origin::Pixel(pixel)), Parametrization::footprint());
    d.scales.sum().backward();
    let grad = footprint.grad().unwrap();
    assert_eq!((grad[1], grad[3]), (0.0, 0.0));
    assert!((grad[2] - 0.7 * 3.0_f64.exp()).abs() < 1e-12);
}

#[test]
fn a_zero_quaternion_has_a_finite_gradient() {
    let tape = Tape::<f64>::new();
    let theta = tape.leaf(&[0.0; 11], [1, 11]);
    let means = tape.constant(&[0.0; 3], [1, 3]);
    let d = decode(means, theta, 0, None, Parametrization::published());
    assert_eq!(d.quats.to_vec(), [0.0; 4]);
    d.quats.sum().backward();
    assert!(theta.grad().unwrap().iter().all(|g| g.is_finite()));
}
