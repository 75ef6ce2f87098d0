//! Rectified Adam.

use crate::Moments;
use weaver_autograd::{ParamId, Params, Real, Tape};

/// The length of the average of squared gradients above which its variance is small enough to divide by it.
const LONG_ENOUGH: f64 = 5.0;

/// Rectified Adam (Liu et al., ICLR 2020, arXiv 1908.03265), which needs no warm-up: while fewer than about five
/// gradients have been seen, it steps along their mean alone; from then on it divides as Adam does, by less than Adam
/// where the squares are still uncertain.
///
/// With m = beta1 m + (1 - beta1) g, v = beta2 v + (1 - beta2) g^2, rho = 2 / (1 - beta2) - 1 and rho_t = rho - 2 t
/// beta2^t / (1 - beta2^t): p = p - rate m / (1 - beta1^t) where rho_t <= 5, else p = p - rate m / (1 - beta1^t) r
/// sqrt(1 - beta2^t) / (sqrt(v) + eps), r^2 = (rho_t - 4)(rho_t - 2) rho / ((rho - 4)(rho - 2) rho_t). The numbers
/// equal PyTorch's `RAdam` without weight decay; eps is added before the bias of v is corrected.
///
/// The moments of a parameter are allocated at its first gradient. A parameter that received no gradient in a step is
/// left as it is and does not count the step.
///
/// ```
/// use weaver_autograd::{Params, Tape};
/// use weaver_nn::RAdam;
/// let mut params = Params::<f64>::new();
/// let w = params.add("w", [1], vec![1.0]);
/// let mut optimizer = RAdam::new(vec![w], 0.9, 0.999, 1e-8);
/// let mut tape = Tape::new();
/// (tape.param(&params, w) * 3.0).sum().backward();
/// optimizer.step(&mut params, &mut tape, |_| 0.1);
/// assert!((params.get(w).value()[0] - 0.7).abs() < 1e-12); // one gradient: along it, by the rate
/// tape.reset();
/// ```
#[derive(Clone, Debug)]
pub struct RAdam<T: Real = f32> {
    /// The parameters that are trained.
    pub params: Vec<ParamId>,
    /// Decay of the mean of gradients.
    pub beta1: f64,
    /// Decay of the mean of squared gradients.
    pub beta2: f64,
    /// Added to the root of the mean square.
    pub eps: f64,
    /// By parameter index; the number of steps a parameter has taken beside its moments.
    pub(crate) state: Vec<(u64, Moments<T>)>,
}

impl<T: Real> RAdam<T> {
    /// An optimizer that has not taken a step.
    pub fn new(params: Vec<ParamId>, beta1: f64, beta2: f64, eps: f64) -> Self {
        Self { params, beta1, beta2, eps, state: Vec::new() }
    }

    /// One step along the gradients that the tape holds, each parameter at the rate that `rate` says. The tape lets go
    /// of the parameters' values, so that they change in place; reset it next.
    pub fn step(&mut self, params: &mut Params<T>, tape: &mut Tape<T>, rate: impl Fn(ParamId) -> f64) {
        tape.release_params();
        for &id in &self.params {
            let Some(gradient) = tape.param_grad(id) else { continue };
            if self.state.len() <= id.index() {
                self.state.resize_with(params.len(), Default::default);
            }
            let (steps, Moments { first, second, .. }) = &mut self.state[id.index()];
            *steps += 1;
            first.resize(gradient.len(), T::ZERO);
            second.resize(gradient.len(), T::ZERO);
            let factors = Factors::new(self.beta1, self.beta2, *steps, rate(id));
            let [plain, adaptive] = [factors.plain, factors.adaptive].map(T::from_f64);
            let [beta1, beta2, eps] = [self.beta1, self.beta2, self.eps].map(T::from_f64);
            let moments = first.iter_mut().zip(second);
            for ((p, g), (m, v)) in params.value_mut(id).iter_mut().zip(gradient.iter()).zip(moments) {
                *m = beta1 * *m + (T::ONE - beta1) * *g;
                *v = beta2 * *v + (T::ONE - beta2) * *g * *g;
                *p -= if factors.rectified { adaptive * *m / (v.sqrt() + eps) } else { plain * *m };
            }
        }
    }
}

/// Factors of a step on the mean of the gradients.
struct Factors {
    /// True if the squares are known well enough.
    rectified: bool,
    /// Rate and bias of the mean.
    plain: f64,
    /// The same with the rectification and the bias of the squares.
    adaptive: f64,
}

impl Factors {
    /// The factors of step t, counted from 1.
    fn new(beta1: f64, beta2: f64, t: u64, rate: f64) -> Self {
        let power = |beta: f64| beta.powf(t as f64);
        let plain = rate / (1.0 - power(beta1));
        let unbiased = 1.0 - power(beta2);
        let most = 2.0 / (1.0 - beta2) - 1.0;
        let length = most - 2.0 * t as f64 * power(beta2) / unbiased;
        let rectified = length > LONG_ENOUGH;
        let variance = (length - 4.0) * (length - 2.0) * most / ((most - 4.0) * (most - 2.0) * length);
        let adaptive = if rectified { plain * (variance * unbiased).sqrt() } else { 0.0 };
        Self { rectified, plain, adaptive }
    }
}
