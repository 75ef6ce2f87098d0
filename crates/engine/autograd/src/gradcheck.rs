//! Gradient checks: compares the gradients of a function on a tape with central differences in `f64`.
//!
//! One call tests the usual mistakes: single coordinates and random directions under random cotangents, gradients that
//! are added to an existing sum, one tensor used as several inputs, and inputs that need no gradient.
//!
//! ```
//! use weaver_autograd::gradcheck::{Input, gradcheck};
//! gradcheck(&[Input::new(&[0.3, -1.2], [2])], |x| vec![(x[0] * x[0]).sum()]);
//! ```

use crate::{Shape, Tape, Var};
use weaver_kernels::random::Stream;

/// Largest error of the sums of a loss and of a gradient, in units of the precision of `f64` and relative to their
/// terms' magnitudes.
const ROUNDING: f64 = 4.0;

/// An input of the function under test.
#[derive(Clone, Debug)]
pub struct Input {
    /// The elements, row-major.
    pub data: Vec<f64>,
    /// The shape.
    pub shape: Shape,
    /// True if the function is differentiable with respect to it. Constants such as targets and masks are not.
    pub differentiable: bool,
}

impl Input {
    /// A differentiable input with the given elements.
    pub fn new(data: &[f64], shape: impl Into<Shape>) -> Self {
        Self { data: data.to_vec(), shape: shape.into(), differentiable: true }
    }

    /// A differentiable input of standard normal numbers that depend on `seed` alone.
    pub fn normal(seed: u64, shape: impl Into<Shape>) -> Self {
        let shape = shape.into();
        let stream = Stream::new(seed, 0, "gradcheck.input");
        Self::new(&(0..shape.len() as u64).map(|i| stream.normal(i)).collect::<Vec<_>>(), shape)
    }

    /// A differentiable input of uniform numbers between `low` and `high` that depend on `seed` alone.
    pub fn uniform(seed: u64, low: f64, high: f64, shape: impl Into<Shape>) -> Self {
        let shape = shape.into();
        let stream = Stream::new(seed, 0, "gradcheck.input");
        let draw = |i| low + (high - low) * stream.uniform::<f64>(i);
        Self::new(&(0..shape.len() as u64).map(draw).collect::<Vec<_>>(), shape)
    }

    /// Makes this input a constant.
    pub fn constant(self) -> Self {
        Self { differentiable: false, ..self }
    }
}

/// The number of checks and their tolerance.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Step size of the central differences.
    pub step: f64,
    /// Largest allowed error of a derivative, relative to the larger of it and the root mean square of the gradient
    /// that it is part of. Beyond that only rounding is allowed: of the outputs, over `step`, and of sums over
    /// cotangents.
    pub tolerance: f64,
    /// Number of coordinates checked per input.
    pub coordinates: usize,
    /// Number of random directions checked, over all inputs together.
    pub directions: usize,
    /// Seed of the cotangents, coordinates and directions.
    pub seed: u64,
    /// Checks also with one tensor in place of two inputs of equal shape.
    pub duplicates: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { step: 1e-5, tolerance: 1e-6, coordinates: 6, directions: 3, seed: 0, duplicates: true }
    }
}

/// Checks the gradient of `f` with the default [`Options`].
///
/// # Panics
///
/// If a derivative is wrong, with its place and both values.
#[track_caller]
pub fn gradcheck<F>(inputs: &[Input], f: F)
where
    F: for<'t> Fn(&[Var<'t, f64>]) -> Vec<Var<'t, f64>>,
{
    gradcheck_with(Options::default(), inputs, f);
}

/// Checks the gradient of `f`, a pure function from tensors to tensors that is smooth where it is evaluated.
///
/// # Panics
///
/// If a derivative is wrong, with its place and both values.
#[track_caller]
pub fn gradcheck_with<F>(options: Options, inputs: &[Input], f: F)
where
    F: for<'t> Fn(&[Var<'t, f64>]) -> Vec<Var<'t, f64>>,
{
    // Compiled once and not for each function that is checked.
    check(&Check { options, f: &f }, inputs);
}

#[track_caller]
fn check(check: &Check<'_>, inputs: &[Input]) {
    let gradient = check.gradient(inputs, &Mode::default());
    check.differences(inputs, &gradient);
    check.seeded(inputs, &gradient);
    check.absent(inputs, &gradient);
    if check.options.duplicates {
        check.duplicates(inputs);
    }
}

/// Checks that `forward` is a linear map and its gradient the adjoint A': <A x, y> = <x, A' y> for random vectors x and
/// y.
///
/// # Panics
///
/// If either does not hold.
#[track_caller]
pub fn adjoint_check<F>(shape: impl Into<Shape>, seed: u64, forward: F)
where
    F: for<'t> Fn(Var<'t, f64>) -> Var<'t, f64>,
{
    let x = Input::normal(seed, shape);
    let tape = Tape::<f64>::new();
    let var = tape.leaf(&x.data, x.shape);
    let out = forward(var);
    if out.shape().is_empty() || x.shape.is_empty() {
        return;
    }
    let y = Input::normal(seed.wrapping_add(1), out.shape());
    out.backward_with(&y.data);
    let left = dot(&out.value(), &y.data);
    let right = dot(&x.data, &var.grad().expect("a linear map passes a gradient to its input"));
    let scale = dot(&x.data, &x.data).sqrt() * dot(&y.data, &y.data).sqrt();
    assert!((left - right).abs() <= 1e-11 * scale.max(1.0), "adjoint: <Ax, y> = {left}, <x, A'y> = {right}");
    // Linearity: A(2x) = 2 A(x), and A(0) = 0.
    let doubled = forward(tape.constant(&x.data.iter().map(|v| 2.0 * v).collect::<Vec<_>>(), x.shape)).to_vec();
    for (twice, once) in doubled.iter().zip(out.to_vec()) {
        assert!((twice - 2.0 * once).abs() <= 1e-10 * (1.0 + once.abs()), "not linear: {twice} against 2 * {once}");
    }
}

/// The root mean square of the gradients of those inputs that a direction changes.
fn typical(parts: &[(&Vec<f64>, &Vec<f64>)]) -> f64 {
    let changed = parts.iter().filter(|(d, _)| d.iter().any(|d| *d != 0.0));
    let (sum, count) = changed.fold((0.0, 0), |(sum, count), (_, g)| (sum + dot(g, g), count + g.len()));
    (sum / count.max(1) as f64).sqrt()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Computation of the gradient: plain, or with a complication that must not change it.
#[derive(Default)]
struct Mode {
    /// Also add <seed, x_i> to the loss, recorded after `f`, so that the backward pass of `f` finds an existing
    /// gradient.
    seeds: Option<Vec<Vec<f64>>>,
    /// Inputs to pass as constants.
    absent: Vec<usize>,
    /// Pass the second input in place of the first.
    alias: Option<(usize, usize)>,
}

/// A function from tensors to tensors.
type Function<'a> = dyn for<'t> Fn(&[Var<'t, f64>]) -> Vec<Var<'t, f64>> + 'a;

struct Check<'a> {
    options: Options,
    f: &'a Function<'a>,
}

impl Check<'_> {
    fn cotangent(&self, output: usize, shape: Shape) -> Vec<f64> {
        let stream = Stream::new(self.options.seed, output as u64, "gradcheck.cotangent");
        (0..shape.len() as u64).map(|i| stream.normal(i)).collect()
    }

    /// The loss, which is the sum of cotangent * output, and a bound on the rounding error of its central difference
    /// and gradient.
    fn loss(&self, inputs: &[Input]) -> (f64, f64) {
        let tape = Tape::<f64>::new();
        let vars: Vec<_> = inputs.iter().map(|x| tape.constant(&x.data, x.shape)).collect();
        let (mut loss, mut magnitude) = (0.0, 0.0);
        for (o, y) in (self.f)(&vars).iter().enumerate() {
            for (y, cotangent) in y.value().iter().zip(self.cotangent(o, y.shape())) {
                loss += y * cotangent;
                magnitude += (y * cotangent).abs() / self.options.step + cotangent.abs();
            }
        }
        (loss, ROUNDING * f64::EPSILON * magnitude)
    }

    fn gradient(&self, inputs: &[Input], mode: &Mode) -> Vec<Option<Vec<f64>>> {
        let tape = Tape::<f64>::new();
        let sources: Vec<_> = inputs
            .iter()
            .enumerate()
            .map(|(i, x)| {
                if x.differentiable && !mode.absent.contains(&i) {
                    tape.leaf(&x.data, x.shape)
                } else {
                    tape.constant(&x.data, x.shape)
                }
            })
            .collect();
        let mut vars = sources.clone();
        if let Some((replaced, by)) = mode.alias {
            vars[replaced] = sources[by];
        }
        let mut loss = tape.scalar(0.0);
        for (o, y) in (self.f)(&vars).into_iter().enumerate() {
            let cotangent = tape.constant(&self.cotangent(o, y.shape()), y.shape());
            assert!(y.value().iter().all(|v| v.is_finite()), "output {o} is not finite: {y:?}");
            loss = loss + (y * cotangent).sum();
        }
        if let Some(seeds) = &mode.seeds {
            for (x, seed) in vars.iter().zip(seeds) {
                loss = loss + (*x * tape.constant(seed, x.shape())).sum();
            }
        }
        if loss.is_tracked() {
            loss.backward();
        }
        sources.iter().map(|x| x.grad()).collect()
    }

    fn differences(&self, inputs: &[Input], gradient: &[Option<Vec<f64>>]) {
        let Options { step, tolerance, .. } = self.options;
        let zero: Vec<Vec<f64>> = inputs.iter().map(|x| vec![0.0; x.data.len()]).collect();
        let mut directions: Vec<(String, Vec<Vec<f64>>)> = Vec::new();
        for (i, x) in inputs.iter().enumerate().filter(|(_, x)| x.differentiable && !x.data.is_empty()) {
            assert!(gradient[i].is_some(), "no gradient reached input {i} of shape {}", x.shape);
            let order = Stream::new(self.options.seed, i as u64, "gradcheck.coordinate").permutation(x.data.len());
            for &at in order.iter().take(self.options.coordinates) {
                let mut direction = zero.clone();
                direction[i][at] = 1.0;
                directions.push((format!("input {i} {}, element {at}", x.shape), direction));
            }
        }
        for d in 0..self.options.directions as u64 {
            let stream = Stream::new(self.options.seed, d, "gradcheck.direction");
            let mut direction = zero.clone();
            let mut count = 0;
            for (values, _) in direction.iter_mut().zip(inputs).filter(|(_, x)| x.differentiable) {
                for v in values {
                    *v = stream.normal(count);
                    count += 1;
                }
            }
            let norm = direction.iter().map(|v| dot(v, v)).sum::<f64>().sqrt();
            if norm > 0.0 {
                direction.iter_mut().flatten().for_each(|v| *v /= norm);
                directions.push((format!("random direction {d}"), direction));
            }
        }
        let moved = |direction: &[Vec<f64>], by: f64| {
            let mut inputs = inputs.to_vec();
            for (x, d) in inputs.iter_mut().zip(direction) {
                x.data.iter_mut().zip(d).for_each(|(x, d)| *x += by * d);
            }
            self.loss(&inputs)
        };
        for (place, direction) in directions {
            let ((above, rounding), (below, _)) = (moved(&direction, step), moved(&direction, -step));
            let numeric = (above - below) / (2.0 * step);
            let parts: Vec<_> = direction.iter().zip(gradient).filter_map(|(d, g)| Some((d, g.as_ref()?))).collect();
            let analytic: f64 = parts.iter().map(|(d, g)| dot(d, g)).sum();
            let scale = analytic.abs().max(numeric.abs()).max(typical(&parts));
            let error = (numeric - analytic).abs();
            assert!(
                error <= tolerance * scale + rounding,
                "gradient at {place}: {analytic} by the op, {numeric} by central differences (error {error:.2e}, where \
                 gradients are {scale:.2e} and rounding is {rounding:.2e})"
            );
        }
    }

    fn seeded(&self, inputs: &[Input], gradient: &[Option<Vec<f64>>]) {
        let seeds: Vec<Vec<f64>> = inputs.iter().enumerate().map(|(i, x)| self.cotangent(100 + i, x.shape)).collect();
        let sum = self.gradient(inputs, &Mode { seeds: Some(seeds.clone()), ..Mode::default() });
        for (i, ((sum, plain), seed)) in sum.iter().zip(gradient).zip(&seeds).enumerate() {
            let (Some(sum), Some(plain)) = (sum, plain) else { continue };
            for k in 0..sum.len() {
                let expected = plain[k] + seed[k];
                assert!(
                    (sum[k] - expected).abs() <= 1e-9 * (1.0 + expected.abs() + plain[k].abs()),
                    "input {i}, element {k}: a gradient added to {} gives {}, not {expected}",
                    seed[k],
                    sum[k]
                );
            }
        }
    }

    fn absent(&self, inputs: &[Input], gradient: &[Option<Vec<f64>>]) {
        let differentiable: Vec<usize> = (0..inputs.len()).filter(|&i| inputs[i].differentiable).collect();
        if differentiable.len() < 2 {
            return;
        }
        for &missing in &differentiable {
            let partial = self.gradient(inputs, &Mode { absent: vec![missing], ..Mode::default() });
            for (i, (partial, full)) in partial.iter().zip(gradient).enumerate().filter(|(i, _)| *i != missing) {
                assert_eq!(
                    partial, full,
                    "the gradient of input {i} changes when that of input {missing} is not needed"
                );
            }
        }
    }

    fn duplicates(&self, inputs: &[Input]) {
        for i in 0..inputs.len() {
            for j in 0..i {
                let same = inputs[i].shape == inputs[j].shape && inputs[i].differentiable && inputs[j].differentiable;
                if !same || inputs[i].data.is_empty() {
                    continue;
                }
                let mut equal = inputs.to_vec();
                equal[i].data = inputs[j].data.clone();
                let apart = self.gradient(&equal, &Mode::default());
                let once = self.gradient(&equal, &Mode { alias: Some((i, j)), ..Mode::default() });
                let (Some(a), Some(b), Some(sum)) = (&apart[i], &apart[j], &once[j]) else { continue };
                for k in 0..sum.len() {
                    let expected = a[k] + b[k];
                    assert!(
                        (sum[k] - expected).abs() <= 1e-9 * (1.0 + a[k].abs() + b[k].abs()),
                        "one tensor as inputs {j} and {i}: element {k} has gradient {}, not {expected}",
                        sum[k]
                    );
                }
            }
        }
    }
}
