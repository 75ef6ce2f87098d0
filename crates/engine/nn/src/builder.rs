//! Builds the parameters of a model: names them by their place in it and draws their initial values.

use weaver_autograd::{ParamId, Params, Real, Shape};
use weaver_kernels::random::Stream;

/// Distribution of the initial values of a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Init {
    /// All equal.
    Constant(f64),
    /// Normal with this standard deviation.
    Normal(f64),
    /// Normal with this standard deviation, truncated at two standard deviations by drawing again.
    TruncatedNormal(f64),
    /// Uniform between minus and plus this bound.
    Uniform(f64),
}

impl Init {
    /// PyTorch's default for linear and convolution layers: uniform within 1/sqrt(fan in), weights and biases alike.
    pub fn fan_in(fan_in: usize) -> Self {
        Self::Uniform(1.0 / (fan_in as f64).sqrt())
    }

    fn draw(self, stream: Stream, i: u64) -> f64 {
        match self {
            Self::Constant(value) => value,
            Self::Normal(std) => std * stream.normal::<f64>(i),
            Self::TruncatedNormal(std) => {
                let stream = stream.fork(i);
                let mut tries = (0..).map(|k| stream.normal::<f64>(k));
                std * tries.find(|z| z.abs() <= 2.0).expect("a normal number within two deviations turns up")
            }
            Self::Uniform(bound) => bound * (2.0 * stream.uniform::<f64>(i) - 1.0),
        }
    }
}

/// Initial weights and biases of a layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WeightInit {
    /// Weights normal with this standard deviation, truncated at two standard deviations; biases 0. Usual for
    /// transformers.
    TruncatedNormal(f64),
    /// Weights and biases uniform within 1/sqrt(fan in): PyTorch's default.
    FanIn,
    /// Weights and biases 0: the layer's initial output is 0.
    Zero,
}

impl WeightInit {
    /// The initial weights and biases of a layer in which every output has `fan_in` inputs.
    pub fn of(self, fan_in: usize) -> (Init, Init) {
        match self {
            Self::TruncatedNormal(std) => (Init::TruncatedNormal(std), Init::Constant(0.0)),
            Self::FanIn => (Init::fan_in(fan_in), Init::fan_in(fan_in)),
            Self::Zero => (Init::Constant(0.0), Init::Constant(0.0)),
        }
    }
}

/// Adds parameters under a path. Every parameter's values depend on the seed and its own name alone, so adding a layer
/// does not change the others.
///
/// ```
/// use weaver_autograd::Params;
/// use weaver_nn::{Builder, Init};
/// let mut params = Params::<f32>::new();
/// let bias = Builder::new(&mut params, 0).scope("head").scope(1).add("bias", [3], Init::Constant(0.5));
/// assert_eq!((params.get(bias).name(), params.get(bias).value()), ("head.1.bias", &[0.5; 3][..]));
/// ```
#[derive(Debug)]
pub struct Builder<'p, T: Real = f32> {
    params: &'p mut Params<T>,
    path: String,
    /// Of the initial values; without one, parameters are declared and their values left to be set.
    seed: Option<u64>,
}

impl<'p, T: Real> Builder<'p, T> {
    /// A builder at the root.
    pub fn new(params: &'p mut Params<T>, seed: u64) -> Self {
        Self { params, path: String::new(), seed: Some(seed) }
    }

    /// A builder at the root that declares parameters without values, for a model whose weights will be loaded.
    pub fn declaring(params: &'p mut Params<T>) -> Self {
        Self { params, path: String::new(), seed: None }
    }

    /// A builder for the part called `name`.
    pub fn scope(&mut self, name: impl std::fmt::Display) -> Builder<'_, T> {
        Builder { path: self.full(name), params: self.params, seed: self.seed }
    }

    /// A builder at the same path, for a constructor that takes its builder by value.
    pub fn scope_here(&mut self) -> Builder<'_, T> {
        Builder { path: self.path.clone(), params: self.params, seed: self.seed }
    }

    /// Adds a parameter called `name` here. Panics if there is one already.
    pub fn add(&mut self, name: impl std::fmt::Display, shape: impl Into<Shape>, init: Init) -> ParamId {
        let (name, shape) = (self.full(name), shape.into());
        let Some(seed) = self.seed else { return self.params.declare(name, shape) };
        let stream = Stream::new(seed, 0, &name);
        let value = (0..shape.len() as u64).map(|i| T::from_f64(init.draw(stream, i))).collect();
        self.params.add(name, shape, value)
    }

    /// The values of a parameter, to overwrite the drawn ones (the bias of an output, for instance); empty where the
    /// builder draws none.
    pub fn value_mut(&mut self, id: ParamId) -> &mut [T] {
        if self.seed.is_some() { self.params.value_mut(id) } else { &mut [] }
    }

    fn full(&self, name: impl std::fmt::Display) -> String {
        if self.path.is_empty() { name.to_string() } else { format!("{}.{name}", self.path) }
    }
}
