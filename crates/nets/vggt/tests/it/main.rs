//! The backbone against references, finite differences and its own mechanisms.

mod aggregator;
mod camera_head;
mod dense;
mod ops;
mod shapes;
mod vision_transformer;

use weaver_autograd::{ParamId, Params, Tape, Var};
use weaver_kernels::random::Stream;
use weaver_nn::Context;

/// Checks a network's gradient with respect to weights: one direction at a time, each moving one tensor.
fn check_weights(params: &Params<f64>, ids: &[ParamId], f: impl for<'t> Fn(Context<'t, '_, f64>) -> Var<'t, f64>) {
    let loss = |params: &Params<f64>, backward: bool| {
        let tape = Tape::new();
        let y = f(Context::new(&tape, params));
        let stream = Stream::new(1, 0, "cotangent");
        let cotangent: Vec<f64> = (0..y.shape().len() as u64).map(|i| stream.normal(i)).collect();
        let value: f64 = y.value().iter().zip(&cotangent).map(|(y, c)| y * c).sum();
        if backward {
            y.backward_with(&cotangent);
        }
        let gradients: Vec<_> = ids.iter().map(|id| tape.param_grad(*id).map(|g| g.to_vec())).collect();
        (value, gradients)
    };
    let (_, gradients) = loss(params, true);
    for (id, gradient) in ids.iter().zip(gradients).filter(|(id, _)| !params.get(**id).shape().is_empty()) {
        let name = params.get(*id).name();
        let gradient = gradient.unwrap_or_else(|| panic!("no gradient reached {name}"));
        let stream = Stream::new(2, 0, name);
        let direction: Vec<f64> = (0..gradient.len() as u64).map(|i| stream.normal(i)).collect();
        let length = direction.iter().map(|d| d * d).sum::<f64>().sqrt();
        let step = 1e-5;
        let moved = |by: f64| {
            let mut params = params.clone();
            params.value_mut(*id).iter_mut().zip(&direction).for_each(|(w, d)| *w += by * d / length);
            loss(&params, false).0
        };
        let numeric = (moved(step) - moved(-step)) / (2.0 * step);
        let analytic = gradient.iter().zip(&direction).map(|(g, d)| g * d).sum::<f64>() / length;
        let error = (numeric - analytic).abs() / analytic.abs().max(1.0);
        assert!(error < 1e-6, "{name}: {analytic} by the tape, {numeric} by differences");
    }
}
