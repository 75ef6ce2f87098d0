//! One file of reference numbers, and the tolerances of comparisons with it.
//!
//! A file holds inputs, weights, cotangents, outputs and gradients computed in f64, and in its metadata its
//! configuration and the error of the same code in f32. Every comparison leaves a [`Line`]; results that were never
//! compared leave one too.

use super::rectifiers::{self, Rectified};
use serde_json::{Value, json};
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::path::Path;
use weaver_autograd::{Params, Real, Shape, Tape, Var};
use weaver_io::safetensors::{TensorData, Tensors};

/// The least error allowed, relative L2.
const FLOOR: f64 = 1e-5;
/// Factor on the f32 error of the file that is allowed.
const FACTOR: f64 = 20.0;
/// Allowed for gradients that vanish in exact arithmetic, absolutely.
const ZERO: f64 = 1e-4;
/// Allowed for gradients of LPIPS, in which a branch of max-pooling or a rectifier may flip.
const FLIPPED: f64 = 1e-2;

/// Verdict of a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    Pass,
    /// Within the bar in f64, and beyond it in f32 for nothing but rectifiers that rounding flipped.
    Flip,
    Fail,
    /// The file is about an item that does not exist here.
    Unknown,
}

impl Verdict {
    fn name(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Flip => "flip",
            Self::Fail => "FAIL",
            Self::Unknown => "not implemented",
        }
    }
}

/// Result of a comparison.
#[derive(Clone, Debug)]
pub struct Line {
    pub key: String,
    /// Relative L2 error; absolute where `exact_zero`.
    pub error: f64,
    /// Largest error.
    pub largest: f64,
    /// Error by f32 of the file's own code, where the metadata has it.
    pub f32_error: Option<f64>,
    pub allowed: f64,
    pub verdict: Verdict,
    pub remark: String,
}

impl Line {
    /// A line about a whole file without any comparison.
    pub fn without_numbers(key: String, verdict: Verdict, remark: String) -> Self {
        let nothing = f64::NAN;
        Self { key, error: nothing, largest: nothing, f32_error: None, allowed: 0.0, verdict, remark }
    }

    pub fn json(&self) -> Value {
        json!({
            "key": self.key,
            "relative_l2": finite(self.error),
            "largest": finite(self.largest),
            "f32_error": self.f32_error,
            "allowed": self.allowed,
            "verdict": self.verdict.name(),
            "remark": self.remark,
        })
    }

    pub fn text(&self) -> String {
        let f32_error = self.f32_error.map_or("      -".into(), |e| format!("{e:7.1e}"));
        let verdict = self.verdict.name();
        let remark = if self.remark.is_empty() { String::new() } else { format!("  ({})", self.remark) };
        format!("{:7.1e} {:7.1e} {f32_error}  {verdict}  {}{remark}", self.error, self.largest, self.key)
    }
}

/// JSON has neither NaN nor infinity.
fn finite(x: f64) -> Value {
    if x.is_finite() { json!(x) } else { json!(x.to_string()) }
}

/// A file and the comparisons made with it.
#[derive(Debug)]
pub struct Reference {
    tensors: Tensors,
    lines: RefCell<Vec<Line>>,
    /// Output keys whose values were used as inputs.
    used: RefCell<BTreeSet<String>>,
    rectified: RefCell<Vec<Rectified>>,
    f32_error: Value,
    gradstat_error: f64,
    exact_zeros: Value,
    index_mismatches: Value,
    pub config: Value,
    pub operations: Value,
    bar: Option<f64>,
}

impl Reference {
    pub fn read(path: &Path) -> Result<Self, String> {
        let tensors = Tensors::read(path).map_err(|e| e.to_string())?;
        let json = |key: &str| -> Result<Value, String> {
            let Some(text) = tensors.metadata.get(key) else { return Ok(Value::Null) };
            serde_json::from_str(text).map_err(|e| format!("{}: metadata {key}: {e}", path.display()))
        };
        let gradstat = json("f32_error_gradstat_max")?;
        Ok(Self {
            f32_error: json("f32_error")?,
            gradstat_error: gradstat[0].as_f64().unwrap_or(0.0),
            exact_zeros: json("exact_zeros")?,
            index_mismatches: json("f32_index_mismatches")?,
            config: json("config")?,
            operations: json("operations")?,
            lines: RefCell::default(),
            used: RefCell::default(),
            rectified: RefCell::default(),
            tensors,
            bar: None,
        })
    }

    /// The file with one bar for every comparison.
    pub fn with_bar(self, bar: f64) -> Self {
        Self { bar: Some(bar), ..self }
    }

    pub fn metadata(&self, key: &str) -> Option<&str> {
        self.tensors.metadata.get(key).map(String::as_str)
    }

    /// A number of the configuration, by its path.
    pub fn size(&self, path: &str) -> usize {
        let value = path.split('.').fold(&self.config, |value, key| &value[key]);
        value.as_u64().unwrap_or_else(|| panic!("config {path}: expected a number, found {value}")) as usize
    }

    /// A list of numbers of the configuration.
    pub fn sizes(&self, path: &str) -> Vec<usize> {
        let value = path.split('.').fold(&self.config, |value, key| &value[key]);
        let list = value.as_array().unwrap_or_else(|| panic!("config {path}: expected a list, found {value}"));
        list.iter().map(|v| v.as_u64().unwrap_or_else(|| panic!("config {path}: a size, not {v}")) as usize).collect()
    }

    pub fn number(&self, path: &str) -> f64 {
        let value = path.split('.').fold(&self.config, |value, key| &value[key]);
        value.as_f64().unwrap_or_else(|| panic!("config {path}: expected a number, found {value}"))
    }

    /// Rows and columns of something like `5x5`.
    pub fn grid(&self, path: &str) -> [usize; 2] {
        let text = self.config[path].as_str().unwrap_or_else(|| panic!("config {path}: expected rows x columns"));
        let (rows, columns) =
            text.split_once('x').unwrap_or_else(|| panic!("config {path}: rows x columns, not {text}"));
        [rows, columns].map(|n| n.parse().unwrap_or_else(|_| panic!("config {path}: rows x columns, not {text}")))
    }

    pub fn keys(&self) -> impl Iterator<Item = &str> {
        self.tensors.tensors.keys().map(String::as_str)
    }

    pub fn has(&self, key: &str) -> bool {
        self.tensors.tensors.contains_key(key)
    }

    pub fn shape(&self, key: &str) -> Vec<usize> {
        self.tensors.tensors.get(key).unwrap_or_else(|| panic!("the file has no {key}")).shape.clone()
    }

    /// Numbers of any type.
    pub fn data<T: Real>(&self, key: &str) -> Vec<T> {
        let tensor = self.tensors.tensors.get(key).unwrap_or_else(|| panic!("the file has no {key}"));
        match &tensor.data {
            TensorData::I32(values) => values.iter().map(|x| T::from_f64(f64::from(*x))).collect(),
            TensorData::U8(values) => values.iter().map(|x| T::from_f64(f64::from(*x))).collect(),
            data => {
                let wide = data.widened().unwrap_or_else(|| panic!("{key}: numbers of type {}", data.dtype()));
                wide.iter().map(|x| T::from_f32(*x)).collect()
            }
        }
    }

    pub fn indices(&self, key: &str) -> Vec<u32> {
        self.data::<f64>(key).iter().map(|x| *x as u32).collect()
    }

    /// Marks an output as an input: it says where to compare.
    pub fn mask(&self, key: &str) -> Vec<bool> {
        self.used.borrow_mut().insert(key.into());
        self.data::<f32>(key).iter().map(|x| *x != 0.0).collect()
    }

    pub fn leaf<'t, T: Real>(&self, tape: &'t Tape<T>, key: &str) -> Var<'t, T> {
        tape.leaf(&self.data(key), Shape::new(&self.shape(key)))
    }

    pub fn constant<'t, T: Real>(&self, tape: &'t Tape<T>, key: &str) -> Var<'t, T> {
        tape.constant(&self.data(key), Shape::new(&self.shape(key)))
    }

    /// sum(cot.NAME * y); 0 where the file has no such cotangent.
    pub fn weighted<'t, T: Real>(&self, y: Var<'t, T>, key: &str) -> Var<'t, T> {
        if !self.has(key) {
            return y.tape().scalar(T::ZERO);
        }
        (y * y.tape().constant(&self.data(key), y.shape())).sum()
    }

    /// The file with another word for one in its keys.
    pub fn with_word(mut self, from: &str, to: &str) -> Self {
        let tensors = std::mem::take(&mut self.tensors.tensors);
        self.tensors.tensors = tensors.into_iter().map(|(key, tensor)| (key.replace(from, to), tensor)).collect();
        self
    }

    /// Overwrites every parameter with the file's `w.NAME`.
    pub fn load<T: Real>(&self, params: &mut Params<T>) {
        for id in params.ids() {
            let key = format!("w.{}", params.get(id).name());
            assert_eq!(params.get(id).shape().dims(), self.shape(&key), "shape of {key}");
            params.value_mut(id).copy_from_slice(&self.data(&key));
        }
    }

    /// Runs the backward pass from a scalar, and records the outputs of rectifiers of the forward pass.
    pub fn backward<T: Real>(&self, loss: Var<'_, T>) {
        self.backward_with(loss, &[T::ONE]);
    }

    /// As [`backward`](Self::backward), from a tensor and its cotangent.
    pub fn backward_with<T: Real>(&self, y: Var<'_, T>, cotangent: &[T]) {
        self.rectified.borrow_mut().extend(rectifiers::on(y.tape()));
        y.backward_with(cotangent);
    }

    /// Compares numbers with the values of a key, where the file has it.
    pub fn check<T: Real>(&self, key: &str, found: &[T]) {
        self.check_where(key, found, |_| true);
    }

    /// As [`check`](Self::check), at the numbers where `counts(i)`.
    pub fn check_where<T: Real>(&self, key: &str, found: &[T], counts: impl Fn(usize) -> bool) {
        if !self.has(key) {
            return;
        }
        let expected: Vec<f64> = self.data(key);
        if found.len() != expected.len() {
            self.fail(key, format!("{} numbers, expected {}", found.len(), expected.len()));
            return;
        }
        let pairs = || found.iter().zip(&expected).enumerate().filter(|(i, _)| counts(*i)).map(|(_, pair)| pair);
        let largest = largest(pairs().map(|(a, b)| a.to_f64() - *b));
        let f32_error = self.f32_error[key][0].as_f64();
        if self.exact_zeros.get(key).is_some() {
            self.push(key, largest, largest, f32_error, ZERO, "exactly 0: absolute");
            return;
        }
        let magnitude = length(pairs().map(|(_, b)| *b));
        let difference = length(pairs().map(|(a, b)| a.to_f64() - *b));
        let error = if magnitude > 0.0 { difference / magnitude } else { difference };
        let allowed = self.bar.unwrap_or_else(|| (FACTOR * f32_error.unwrap_or(0.0)).max(FLOOR));
        if (key.starts_with("grad.lpips") || key.starts_with("grad_lpips")) && error > allowed {
            self.push(key, error, largest, f32_error, FLIPPED, "a branch may have flipped");
        } else {
            self.push(key, error, largest, f32_error, allowed, "");
        }
    }

    /// Compares indices one by one; as many as the file allows may differ. True if they pass.
    pub fn check_indices(&self, key: &str, found: &[u32]) -> bool {
        self.check_rows(key, found, 1)
    }

    /// Compares indices as sets, row by row; as many rows as the file allows may differ.
    pub fn check_rows(&self, key: &str, found: &[u32], row: usize) -> bool {
        if !self.has(key) {
            return true;
        }
        let expected = self.indices(key);
        if found.len() != expected.len() {
            return self.fail(key, format!("{} indices, expected {}", found.len(), expected.len()));
        }
        let set = |row: &[u32]| row.iter().copied().collect::<BTreeSet<_>>();
        let differ = found.chunks(row).zip(expected.chunks(row)).filter(|(a, b)| set(a) != set(b)).count();
        let allowed = self.index_mismatches[key].as_f64().unwrap_or(0.0);
        let rows = found.len() / row.max(1);
        self.push(key, differ as f64, differ as f64, None, allowed, &format!("rows that differ, of {rows}"))
    }

    /// Compares the gradient of a tensor.
    pub fn check_grad<T: Real>(&self, key: &str, x: Var<'_, T>) {
        match x.grad() {
            Some(gradient) => self.check(key, &gradient),
            None if self.has(key) => {
                self.fail(key, "no gradient".into());
            }
            None => {}
        }
    }

    /// Compares every parameter's gradient, in full where the file has it, and its norm, sum and weighted sum.
    pub fn check_params<T: Real>(&self, params: &Params<T>, tape: &Tape<T>) {
        for (id, param) in params.iter() {
            let name = param.name();
            let (full, stat) = (format!("grad.w.{name}"), format!("gradstat.w.{name}"));
            let Some(gradient) = tape.param_grad(id) else {
                for key in [full, stat].iter().filter(|key| self.has(key)) {
                    self.fail(key, "no gradient".into());
                }
                continue;
            };
            self.check(&full, &gradient);
            if self.has(&stat) {
                self.check_statistics(&stat, &gradient);
            }
        }
    }

    fn check_statistics<T: Real>(&self, key: &str, gradient: &[T]) {
        let g = || gradient.iter().enumerate().map(|(i, g)| (i as f64, g.to_f64()));
        let found =
            [length(g().map(|(_, g)| g)), g().map(|(_, g)| g).sum(), g().map(|(i, g)| g * (0.7 * i + 0.3).cos()).sum()];
        let expected: Vec<f64> = self.data(key);
        let difference = || found.iter().zip(&expected).map(|(a, b)| a - b);
        let largest = largest(difference());
        if self.exact_zeros.get(key).is_some() {
            self.push(key, largest, largest, None, ZERO, "exactly 0: absolute");
            return;
        }
        let error = length(difference()) / length(expected.iter().copied()).max(f64::MIN_POSITIVE);
        let allowed = (FACTOR * self.gradstat_error).max(FLOOR);
        self.push(key, error, largest, Some(self.gradstat_error), allowed, "norm, sum, weighted sum");
    }

    /// Leaves a line that failed for another reason than numbers.
    pub fn fail(&self, key: &str, remark: String) -> bool {
        self.push(key, f64::NAN, f64::NAN, None, 0.0, &remark)
    }

    fn push(&self, key: &str, error: f64, largest: f64, f32_error: Option<f64>, allowed: f64, remark: &str) -> bool {
        // NaN is never within a bound.
        let passed = error <= allowed;
        let verdict = if passed { Verdict::Pass } else { Verdict::Fail };
        let remark = remark.to_string();
        self.lines.borrow_mut().push(Line { key: key.into(), error, largest, f32_error, allowed, verdict, remark });
        passed
    }

    /// Runs `f` without keeping its comparisons: they were made before.
    pub fn unrecorded<R>(&self, f: impl FnOnce() -> R) -> R {
        let before = self.lines.borrow().len();
        let result = f();
        self.lines.borrow_mut().truncate(before);
        result
    }

    /// The lines, with one for each output and gradient that was never compared, and the outputs of rectifiers.
    pub fn finish(self) -> (Vec<Line>, Vec<Rectified>) {
        let compared: BTreeSet<String> = self.lines.borrow().iter().map(|line| line.key.clone()).collect();
        for key in self.tensors.tensors.keys().filter(|key| is_result(key)) {
            if !compared.contains(key) && !self.used.borrow().contains(key) {
                self.fail(key, "nothing was compared with it".into());
            }
        }
        (self.lines.into_inner(), self.rectified.into_inner())
    }
}

/// True if a key is something to reproduce, by its name.
fn is_result(key: &str) -> bool {
    const RESULTS: [&str; 7] = ["out", "grad", "gradstat", "grad_lpips", "loss", "edge", "filter"];
    let mut parts = key.split('.');
    let (first, second) = (parts.next().unwrap_or(""), parts.next().unwrap_or(""));
    let operation = matches!(second, "out" | "grad") && !["in", "w", "cot", "alt"].contains(&first);
    (RESULTS.contains(&first) && key != "edge.theta") || operation
}

fn length(values: impl Iterator<Item = f64>) -> f64 {
    values.map(|x| x * x).sum::<f64>().sqrt()
}

/// The largest absolute value; NaN if there is one.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |max, x| if x.abs() > max || x.is_nan() { x.abs() } else { max })
}
