//! The factorized prior: a distribution of one channel as a small monotone network.

use crate::rates::bits;

/// Widths of the layers, the number first and the logit last.
const WIDTHS: [usize; 5] = [1, 3, 3, 3, 1];
const LAYERS: usize = WIDTHS.len() - 1;
const WIDEST: usize = 3;

/// Numbers of a prior: matrices, biases and gates of all layers.
pub const PRIOR_PARAMETERS: usize = 24 + 10 + 9;

/// A cumulative distribution `c(x) = σ(f_4 ∘ f_3 ∘ f_2 ∘ f_1(x))` of learned shape (Ballé et al., 2018), filters 3, 3,
/// 3.
///
/// `f_k(x) = g(softplus(H) x + b)`, `g(u) = u + tanh(a) tanh(u)`, without `g` in the last layer. Every factor is
/// positive, so that `c` rises. Parameters of a layer are `H` row by row, `b`, then `a`.
#[derive(Clone, Debug, PartialEq)]
pub struct FactorizedPrior {
    /// Parameters, layer by layer.
    pub parameters: [f64; PRIOR_PARAMETERS],
}

/// Bits of a number under a prior, and their derivatives.
#[derive(Clone, Debug, PartialEq)]
pub struct PriorRate {
    /// `-log2 max(c(x + ½) - c(x - ½), 1e-6)`.
    pub bits: f64,
    /// Derivative by `x`.
    pub by_x: f64,
    /// Derivatives by the parameters.
    pub by_parameters: [f64; PRIOR_PARAMETERS],
}

fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

fn softplus(x: f64) -> f64 {
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

/// Where the matrix, the bias and the gate of a layer lie among the parameters.
fn places(layer: usize) -> [usize; 3] {
    let parts = |k: usize| {
        let (inputs, outputs) = (WIDTHS[k], WIDTHS[k + 1]);
        [inputs * outputs, outputs, if k + 1 < LAYERS { outputs } else { 0 }]
    };
    let start: usize = (0..layer).flat_map(parts).sum();
    let [matrix, bias, _] = parts(layer);
    [start, start + matrix, start + matrix + bias]
}

/// Inputs of all layers, and their sums before the gates.
struct Trace {
    inputs: [[f64; WIDEST]; LAYERS],
    sums: [[f64; WIDEST]; LAYERS],
}

impl FactorizedPrior {
    /// A broad distribution about zero of this width, as training begins with; 10 is usual.
    pub fn new(width: f64) -> Self {
        let mut parameters = [0.0; PRIOR_PARAMETERS];
        let scale = width.powf(1.0 / LAYERS as f64);
        for layer in 0..LAYERS {
            let [matrix, bias, _] = places(layer);
            // softplus(H) · outputs = 1 / scale
            parameters[matrix..bias].fill((1.0 / (scale * WIDTHS[layer + 1] as f64)).exp_m1().ln());
            // Different biases, that the rows may become different; their mean is zero.
            let rows = WIDTHS[layer + 1];
            for (row, b) in parameters[bias..bias + rows].iter_mut().enumerate() {
                *b = (row as f64 + 0.5) / rows as f64 - 0.5;
            }
        }
        Self { parameters }
    }

    /// The probability of numbers up to `x`.
    pub fn cumulative(&self, x: f64) -> f64 {
        sigmoid(self.logit(x).0)
    }

    /// Bits of a number that was rounded with step 1, or carries noise of that width instead, with all derivatives.
    pub fn rate(&self, x: f64) -> PriorRate {
        let ((upper, above), (lower, below)) = (self.logit(x + 0.5), self.logit(x - 0.5));
        // Mirrored into the lower tail, where differences of σ keep their digits.
        let side = if upper + lower > 0.0 { -1.0 } else { 1.0 };
        let (bits, slope) = bits((sigmoid(side * upper) - sigmoid(side * lower)).abs());
        let density = |logit: f64| sigmoid(logit) * sigmoid(-logit);
        let mut rate = PriorRate { bits, by_x: 0.0, by_parameters: [0.0; PRIOR_PARAMETERS] };
        self.descend(&above, slope * density(upper), &mut rate);
        self.descend(&below, -slope * density(lower), &mut rate);
        rate
    }

    fn logit(&self, x: f64) -> (f64, Trace) {
        let mut trace = Trace { inputs: [[0.0; WIDEST]; LAYERS], sums: [[0.0; WIDEST]; LAYERS] };
        let mut values = [x, 0.0, 0.0];
        for layer in 0..LAYERS {
            let [matrix, bias, gate] = places(layer);
            let (inputs, outputs) = (WIDTHS[layer], WIDTHS[layer + 1]);
            trace.inputs[layer] = values;
            for (row, value) in values.iter_mut().enumerate().take(outputs) {
                let factors = &self.parameters[matrix + row * inputs..][..inputs];
                let products = factors.iter().zip(&trace.inputs[layer]).map(|(h, v)| softplus(*h) * v);
                let sum = products.sum::<f64>() + self.parameters[bias + row];
                trace.sums[layer][row] = sum;
                *value = sum + if layer + 1 < LAYERS { self.parameters[gate + row].tanh() * sum.tanh() } else { 0.0 };
            }
        }
        (values[0], trace)
    }

    /// Adds the derivatives of `slope` times a logit.
    fn descend(&self, trace: &Trace, slope: f64, rate: &mut PriorRate) {
        let mut slopes = [slope, 0.0, 0.0];
        for layer in (0..LAYERS).rev() {
            let [matrix, bias, gate] = places(layer);
            let (inputs, outputs) = (WIDTHS[layer], WIDTHS[layer + 1]);
            let mut before = [0.0; WIDEST];
            for (row, &slope) in slopes.iter().enumerate().take(outputs) {
                let mut by_sum = slope;
                if layer + 1 < LAYERS {
                    let (a, t) = (self.parameters[gate + row].tanh(), trace.sums[layer][row].tanh());
                    rate.by_parameters[gate + row] += slope * t * (1.0 - a * a);
                    by_sum += slope * a * (1.0 - t * t);
                }
                rate.by_parameters[bias + row] += by_sum;
                for (column, before) in before.iter_mut().enumerate().take(inputs) {
                    let h = self.parameters[matrix + row * inputs + column];
                    rate.by_parameters[matrix + row * inputs + column] +=
                        by_sum * trace.inputs[layer][column] * sigmoid(h);
                    *before += by_sum * softplus(h);
                }
            }
            slopes = before;
        }
        rate.by_x += slopes[0];
    }
}
