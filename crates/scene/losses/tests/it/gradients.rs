//! Every loss against finite differences, memory of a repeated step, and bits at any number of threads.

use proptest::prelude::*;
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_autograd::{Real, Shape, Tape, Var};
use weaver_kernels::order::quantile;
use weaver_losses::*;

fn image(seed: u64, shape: impl Into<Shape>) -> Input {
    Input::uniform(seed, 0.05, 0.95, shape)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 20))]

    #[test]
    fn of_squared_errors(n in 1..4usize, h in 1..5usize, w in 1..5usize, seed in any::<u64>()) {
        let (a, b) = (image(seed, [n, 3, h, w]), image(!seed, [n, 3, h, w]));
        gradcheck(&[a, b], |x| vec![mse(x[0], x[1])]);
    }

    #[test]
    fn of_depth(v in 1..4usize, h in 1..5usize, w in 1..5usize, seed in any::<u64>()) {
        let confidence = image(seed ^ 1, [v, h, w]).constant();
        let depths = [image(seed, [v, h, w]), image(!seed, [v, h, w]), confidence];
        gradcheck(&depths, |x| vec![masked_depth_mse(x[0], x[1], x[2], 0.3)]);
        let mut sparse = image(seed, [v, h, w]).constant();
        sparse.data.iter_mut().step_by(3).for_each(|t| *t = 0.0);
        gradcheck(&[Input::normal(seed, [v, h, w]), sparse], |x| vec![sparse_log_depth_l1(x[0], x[1], 1.7)]);
        let mut known = image(seed ^ 2, [v, h, w]).constant();
        known.data.iter_mut().step_by(3).for_each(|t| *t = 0.0);
        let predicted = [Input::normal(seed, [v, h, w]), Input::normal(!seed, [v, h, w]), known.clone()];
        gradcheck(&predicted, |x| vec![laplacian_log_depth(x[0], x[1], x[2])]);
        // The loss itself, pixel by pixel.
        let (mut sum, mut count) = (0.0, 1.0);
        for ((l, u), t) in predicted[0].data.iter().zip(&predicted[1].data).zip(&known.data).filter(|(_, t)| **t > 0.0) {
            (sum, count) = (sum + (l - t.ln()).abs() * (-u).exp() + u, count + 1.0);
        }
        let tape = Tape::<f64>::new();
        let [l, u, t] = predicted.each_ref().map(|x| tape.constant(&x.data, [v, h, w]));
        prop_assert!((laplacian_log_depth(l, u, t).item() - sum / count).abs() < 1e-9);
    }

    #[test]
    fn of_relative_poses(pairs in 1..5usize, seed in any::<u64>()) {
        // Rows near rotations by small angles: the cosine is far from its bounds.
        let mut rotations = [Input::uniform(seed, -0.2, 0.2, [pairs, 9]), Input::uniform(!seed, -0.2, 0.2, [pairs, 9])];
        rotations.iter_mut().for_each(|r| r.data.chunks_mut(9).for_each(|r| [0, 4, 8].into_iter().for_each(|i| r[i] += 0.7)));
        gradcheck(&rotations, |x| vec![rotation_angles(x[0], x[1])]);
        gradcheck(&[Input::normal(seed, [pairs, 4]), Input::normal(!seed, [pairs, 4])], |x| vec![focal_error(x[0], x[1], 3)]);
    }

    #[test]
    fn of_poses(n in 1..5usize, v in 1..4usize, seed in any::<u64>()) {
        let one = |i: usize, shape: &[usize]| Input::normal(seed.wrapping_add(i as u64), shape);
        let of = |shape: &[usize]| (0..2 * n).map(|i| one(i, shape)).collect::<Vec<_>>();
        gradcheck(&of(&[v, 9]), |x| vec![huber_pose(&x[..n], &x[n..], 1.0)]);
        gradcheck(&of(&[v, 9])[..n + 1], |x| vec![l1_pose(&x[..n], x[n])]);
        let mut poses = of(&[v, 3, 3]);
        poses.truncate(n + 1);
        poses.extend(of(&[v, 3]).into_iter().take(n + 1));
        gradcheck(&poses, |x| vec![absolute_pose(&x[..n], &x[n + 1..2 * n + 1], x[n], x[2 * n + 1])]);
    }

    #[test]
    fn of_the_router(p in 1..20usize, seed in any::<u64>()) {
        let choice = [image(seed, [p, 4])];
        gradcheck(&choice, |x| vec![share_budget(x[0], &[0.2, 0.02, 0.02]), global_budget(x[0], 0.1)]);
        let logits = Input::normal(seed, [p, 4]);
        let energy = image(!seed, [p]).constant();
        gradcheck(&[logits, energy], |x| vec![ranking_cross_entropy(x[0], x[1], &[0.5, 0.9, 0.95], 0.1)]);
    }

    #[test]
    fn of_error_regression(v in 1..3usize, h in 1..5usize, w in 1..5usize, seed in any::<u64>()) {
        let inputs = [Input::normal(seed, [v, h, w]), image(!seed, [v, h, w]).constant()];
        gradcheck(&inputs, |x| vec![error_regression(x[0], x[1], None)]);
    }

    #[test]
    fn of_quantiles(n in 1..12usize, q in prop::collection::vec(0.0..=1.0, 1..4), seed in any::<u64>()) {
        let mut x = image(seed, [n]);
        // Distinct: each number plus its rank.
        let ranks: Vec<_> = x.data.iter().map(|a| x.data.iter().filter(|b| *b < a).count()).collect();
        x.data.iter_mut().zip(ranks).for_each(|(x, rank)| *x += rank as f64);
        gradcheck(std::slice::from_ref(&x), |x| vec![quantiles(x[0], &q)]);
        let tape = Tape::<f64>::new();
        let found = quantiles(tape.constant(&x.data, [n]), &q).to_vec();
        prop_assert_eq!(found, q.iter().map(|q| quantile(&mut x.data.clone(), *q)).collect::<Vec<_>>());
    }

    #[test]
    fn of_max_pooling(n in 0..3usize, h in 3..8usize, w in 3..8usize, window in 1..4usize, seed in any::<u64>()) {
        let (size, stride) = (window, 1 + seed as usize % 3);
        gradcheck(&[Input::normal(seed, [n, 2, h, w])], |x| vec![max_pool2d(x[0], size, stride)]);
    }
}

/// A loss made of all of them, on tensors that need a gradient.
fn everything<'t, T: Real>(tape: &'t Tape<T>) -> (Var<'t, T>, Vec<Var<'t, T>>) {
    let leaf = |seed, shape: &[usize]| {
        let input = image(seed, shape);
        tape.leaf(&input.data.iter().map(|x| T::from_f64(*x)).collect::<Vec<_>>(), shape)
    };
    let (render, photo) = (leaf(1, &[4, 3, 20, 24]), leaf(2, &[4, 3, 20, 24]).detach());
    let (depth, known, confidence) =
        (leaf(3, &[4, 20, 24]), leaf(4, &[4, 20, 24]).detach(), leaf(5, &[4, 20, 24]).detach());
    let (logits, code, target) = (leaf(6, &[1920, 4]), leaf(7, &[4, 9]), leaf(8, &[4, 9]).detach());
    let score = leaf(9, &[4, 20, 24]);
    let terms = [
        mse(render, photo),
        ssim(render, photo).mean(),
        max_pool2d(render, 3, 2).mean(),
        masked_depth_mse(depth, known, confidence, 0.3),
        sparse_log_depth_l1(depth, known, 2.0),
        huber_pose(&[code, code], &[target, target], 1.0) + l1_pose(&[code], target),
        share_budget(logits, &[0.2, 0.02, 0.02]) + global_budget(logits, 0.3),
        ranking_cross_entropy(logits, known.reshape([1920]), &[0.76, 0.96, 0.98], 0.1),
        error_regression(score, known, None),
        quantiles(depth, &[0.3, 0.9]).sum(),
    ];
    let sum = terms.into_iter().reduce(|sum, term| sum + term).unwrap();
    (sum, vec![render, depth, logits, code, score])
}

#[test]
fn a_repeated_step_takes_no_new_memory() {
    let mut tape = Tape::<f32>::new();
    let mut step = || {
        everything(&tape).0.backward();
        tape.reset();
        tape.pool().allocated_bytes()
    };
    let first = step();
    assert_eq!((step(), step()), (first, first));
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let tape = Tape::<f32>::new();
            let (loss, leaves) = everything(&tape);
            loss.backward();
            (loss.item().to_bits(), leaves.iter().map(|x| x.grad().unwrap()).collect::<Vec<_>>())
        })
    };
    assert_eq!(run(1), run(3));
}

/// At the truth the clamp holds the angle at its floor, and lets no gradient through.
#[test]
fn equal_rotations_have_no_gradient() {
    let tape = Tape::<f64>::new();
    let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let a = tape.leaf(&identity, [1, 9]);
    let angle = rotation_angles(a, tape.constant(&identity, [1, 9]));
    assert!((angle.item() - (1.0 - 1e-6_f64).acos()).abs() < 1e-12, "{}", angle.item());
    angle.sum().backward();
    assert_eq!(a.grad().unwrap(), [0.0; 9]);
}
