//! Reference numbers of `tests/fixtures`, and comparison with them at the accuracy of the arithmetic.
//!
//! A file holds inputs, weights, cotangents, outputs and gradients computed in `f64`, and in its metadata the relative
//! errors that the same code makes in `f32` (`f32_error`: L2 and largest).

use half::f16;
use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use weaver_autograd::{Params, Real, Tape, Var};

/// Largest error of a sum that vanishes in exact arithmetic.
const ZERO: f64 = 1e-4;

/// A tensor of a file.
#[derive(Clone, Debug)]
pub struct Array {
    /// Its shape.
    pub shape: Vec<usize>,
    /// Its numbers; each type of file fits into `f64`.
    pub numbers: Vec<f64>,
}

/// Error that a comparison allows, relative to the reference.
#[derive(Clone, Copy, Debug)]
pub struct Tolerance {
    /// Multiple of the error of single precision.
    pub times: f64,
    /// Error that is always allowed.
    pub least: f64,
    /// Smallest size that an error is relative to.
    pub size: f64,
    /// True if the largest error over the largest number is bounded as well as the L2 error.
    pub largest: bool,
}

impl Tolerance {
    /// Tolerance for code that runs in `f32`.
    pub const SINGLE: Self = Self { times: 20.0, least: 1e-5, size: 0.0, largest: true };
    /// Tolerance for code that runs in `f64`, where sums that cancel are as exact as the file.
    pub const DOUBLE: Self = Self { times: 1.0, least: 1e-6, size: 1e-6, largest: false };
}

/// A file of reference numbers.
#[derive(Clone, Debug)]
pub struct Fixture {
    arrays: BTreeMap<String, Array>,
    metadata: BTreeMap<&'static str, Value>,
    tolerance: Tolerance,
}

impl Fixture {
    /// Reads a file in `tests/fixtures`, which must exist, for comparison in single precision.
    pub fn open(name: &str) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures").join(name);
        let bytes = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let file = SafeTensors::deserialize(&bytes).expect("a safetensors file");
        let arrays = file
            .iter()
            .map(|(key, view)| (key.to_string(), Array { shape: view.shape().to_vec(), numbers: numbers(key, &view) }));
        let (_, header) = SafeTensors::read_metadata(&bytes).expect("a safetensors header");
        let text = |key| header.metadata().as_ref().and_then(|metadata| metadata.get(key));
        let value = |key| Some((key, serde_json::from_str(text(key)?).expect("JSON")));
        let metadata = ["f32_error", "f32_error_gradstat_max", "exact_zeros"].into_iter().filter_map(value);
        Self { arrays: arrays.collect(), metadata: metadata.collect(), tolerance: Tolerance::SINGLE }
    }

    /// The same file with another tolerance.
    pub fn with(self, tolerance: Tolerance) -> Self {
        Self { tolerance, ..self }
    }

    /// True if the file holds a tensor.
    pub fn has(&self, key: &str) -> bool {
        self.arrays.contains_key(key)
    }

    /// The keys of all tensors.
    pub fn keys(&self) -> impl Iterator<Item = &str> {
        self.arrays.keys().map(String::as_str)
    }

    /// The tensor of a key.
    pub fn array(&self, key: &str) -> &Array {
        self.arrays.get(key).unwrap_or_else(|| panic!("the file has no {key}"))
    }

    /// The shape of a tensor.
    pub fn shape(&self, key: &str) -> &[usize] {
        &self.array(key).shape
    }

    /// The shape of a tensor, and its numbers in single precision.
    pub fn tensor(&self, key: &str) -> (Vec<f32>, Vec<usize>) {
        (self.f32(key), self.shape(key).to_vec())
    }

    /// The numbers of a tensor in single precision.
    pub fn f32(&self, key: &str) -> Vec<f32> {
        self.of(key)
    }

    fn of<T: Real>(&self, key: &str) -> Vec<T> {
        self.array(key).numbers.iter().map(|x| T::from_f64(*x)).collect()
    }

    /// The numbers of a tensor in double precision.
    pub fn f64(&self, key: &str) -> Vec<f64> {
        self.array(key).numbers.clone()
    }

    /// A tensor of indices.
    pub fn indices(&self, key: &str) -> Vec<u32> {
        self.array(key).numbers.iter().map(|x| *x as u32).collect()
    }

    /// A tensor as a leaf.
    pub fn leaf<'t, T: Real>(&self, tape: &'t Tape<T>, key: &str) -> Var<'t, T> {
        tape.leaf(&self.of(key), self.shape(key))
    }

    /// A tensor as a constant.
    pub fn constant<'t, T: Real>(&self, tape: &'t Tape<T>, key: &str) -> Var<'t, T> {
        tape.constant(&self.of(key), self.shape(key))
    }

    /// Overwrites every parameter with the file's `w.NAME`.
    pub fn load<T: Real>(&self, params: &mut Params<T>) {
        for id in params.ids() {
            let key = format!("w.{}", params.get(id).name());
            assert_eq!(params.get(id).shape().dims(), self.shape(&key), "{key}");
            params.value_mut(id).copy_from_slice(&self.of(&key));
        }
    }

    /// The remainder in single precision of a gradient that vanishes in exact arithmetic; `None` for any other.
    pub fn exact_zero(&self, key: &str) -> Option<f64> {
        self.metadata.get("exact_zeros")?.get(key)?.as_f64()
    }

    /// The largest error by single precision of the sums of a gradient, relative to its norm.
    pub fn gradient_error(&self) -> f64 {
        let all = self.metadata["f32_error_gradstat_max"].as_array().expect("a list");
        all.iter().filter_map(Value::as_f64).fold(0.0, f64::max)
    }

    /// Panics unless `found` is the tensor within the tolerance.
    #[track_caller]
    pub fn assert_close<T: Real>(&self, key: &str, found: &[T]) {
        let expected = &self.array(key).numbers;
        assert_eq!(found.len(), expected.len(), "{key}");
        let differences: Vec<f64> = found.iter().zip(expected).map(|(a, b)| a.to_f64() - b).collect();
        if self.exact_zero(key).is_some() {
            let found = largest(&differences);
            assert!(found <= ZERO, "{key}: {found:.2e}, where exact arithmetic gives 0");
            return;
        }
        let Tolerance { times, least, size, largest: peak } = self.tolerance;
        let single = self.metadata.get("f32_error").and_then(|errors| errors.get(key));
        let errors = [length(&differences), largest(&differences)];
        let sizes = [length(expected), largest(expected)];
        for measure in 0..if peak { 2 } else { 1 } {
            let single = single.and_then(|errors| errors[measure].as_f64()).unwrap_or(0.0);
            let (error, allowed) = (errors[measure], (times * single).max(least));
            let of = if sizes[measure] == 0.0 { 1.0 } else { sizes[measure] }.max(size);
            assert!(error <= allowed * of, "{key}: error {:.2e} of {of:.2e}, allowed {allowed:.2e}", error / of);
        }
    }

    /// Panics unless every parameter's gradient is the file's: in full where the file has it, and its norm, sum and a
    /// weighted sum.
    #[track_caller]
    pub fn assert_gradients(&self, params: &Params<f32>, tape: &Tape<f32>) {
        let mut compared = 0;
        for (id, param) in params.iter() {
            let name = param.name();
            let statistics = format!("gradstat.w.{name}");
            let Some(expected) = self.arrays.get(&statistics) else { continue };
            let gradient = tape.param_grad(id).unwrap_or_else(|| panic!("no gradient reached {name}"));
            let key = format!("grad.w.{name}");
            if self.has(&key) {
                self.assert_close(&key, &gradient);
            }
            let norm = expected.numbers[0];
            let allowed = match self.exact_zero(&key).or(self.exact_zero(&statistics)) {
                Some(_) => ZERO,
                None => (self.tolerance.times * self.gradient_error()).max(self.tolerance.least) * norm,
            };
            for (found, expected) in gradient_statistics(&gradient).iter().zip(&expected.numbers) {
                let error = (found - expected).abs();
                assert!(error <= allowed, "gradient of {name}: {found} against {expected} (norm {norm})");
            }
            compared += 1;
        }
        let all = self.keys().filter(|key| key.starts_with("gradstat.")).count();
        assert_eq!(compared, all, "gradients compared, of those in the file");
    }
}

/// Norm, sum and a weighted sum of a gradient, as stored in files.
pub fn gradient_statistics<T: Real>(gradient: &[T]) -> [f64; 3] {
    let all = || gradient.iter().map(|g| g.to_f64());
    let weighted = all().enumerate().map(|(i, g)| g * (0.7 * i as f64 + 0.3).cos());
    [all().map(|g| g * g).sum::<f64>().sqrt(), all().sum(), weighted.sum()]
}

fn numbers(key: &str, view: &TensorView<'_>) -> Vec<f64> {
    let words = || view.data().as_chunks().0.iter().copied();
    match view.dtype() {
        Dtype::F32 => words().map(|b| f32::from_le_bytes(b).into()).collect(),
        Dtype::I32 => words().map(|b| i32::from_le_bytes(b).into()).collect(),
        Dtype::F16 => view.data().as_chunks().0.iter().map(|b| f16::from_le_bytes(*b).into()).collect(),
        Dtype::U8 => view.data().iter().map(|b| f64::from(*b)).collect(),
        other => panic!("{key}: numbers of type {other:?}"),
    }
}

fn length(values: &[f64]) -> f64 {
    values.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The largest absolute value; NaN if there is one.
fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most: f64, x| if x.abs() > most || x.is_nan() { x.abs() } else { most })
}
