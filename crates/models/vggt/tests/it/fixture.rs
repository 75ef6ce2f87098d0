//! Reads reference numbers, and compares with them at the accuracy that f32 can have.
//!
//! A file holds inputs, weights, cotangents, outputs and gradients computed in f64, and in its metadata what the
//! same code loses in f32 (`f32_error`). A result passes within twenty times that, or 1e-5 if that is more.

use half::f16;
use safetensors::{Dtype, SafeTensors};
use std::collections::BTreeMap;
use std::path::Path;
use weaver_autograd::{Params, Tape, Var};

/// One tensor of a file.
#[derive(Clone, Debug)]
pub struct Array {
    pub shape: Vec<usize>,
    pub data: Vec<f32>,
}

/// One file of reference numbers.
#[derive(Debug)]
pub struct Fixture {
    arrays: BTreeMap<String, Array>,
    errors: BTreeMap<String, Vec<f64>>,
    gradstat_error: f64,
    exact_zeros: Vec<String>,
}

impl Fixture {
    /// The named file of the repository.
    pub fn named(name: &str) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../tests/fixtures").join(name);
        let bytes = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let arrays = file
            .iter()
            .filter_map(|(name, view)| {
                let data = match view.dtype() {
                    Dtype::F32 => {
                        view.data().chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
                    }
                    Dtype::F16 => {
                        view.data().chunks_exact(2).map(|b| f16::from_le_bytes(b.try_into().unwrap()).into()).collect()
                    }
                    _ => return None,
                };
                Some((name.to_string(), Array { shape: view.shape().to_vec(), data }))
            })
            .collect();
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        let metadata = header.metadata().as_ref().unwrap();
        let json = |key: &str| -> serde_json::Value { serde_json::from_str(&metadata[key]).unwrap() };
        Self {
            arrays,
            errors: serde_json::from_value(json("f32_error")).unwrap(),
            gradstat_error: json("f32_error_gradstat_max")
                .as_array()
                .unwrap()
                .iter()
                .map(|v| v.as_f64().unwrap())
                .fold(0.0, f64::max),
            exact_zeros: json("exact_zeros").as_object().unwrap().keys().cloned().collect(),
        }
    }

    /// The tensor with this key.
    pub fn array(&self, key: &str) -> &Array {
        self.arrays.get(key).unwrap_or_else(|| panic!("the file has no {key}"))
    }

    /// A tensor as a leaf.
    pub fn leaf<'t>(&self, tape: &'t Tape<f32>, key: &str) -> Var<'t, f32> {
        let array = self.array(key);
        tape.leaf(&array.data, array.shape.as_slice())
    }

    /// A tensor as a constant.
    pub fn constant<'t>(&self, tape: &'t Tape<f32>, key: &str) -> Var<'t, f32> {
        let array = self.array(key);
        tape.constant(&array.data, array.shape.as_slice())
    }

    /// Overwrites every parameter with the file's `w.<name>`.
    pub fn load(&self, params: &mut Params<f32>) {
        let ids: Vec<_> = params.iter().map(|(id, p)| (id, p.name().to_string(), p.shape())).collect();
        for (id, name, shape) in ids {
            let array = self.array(&format!("w.{name}"));
            assert_eq!(shape.dims(), array.shape, "{name}");
            params.value_mut(id).copy_from_slice(&array.data);
        }
    }

    /// Compares numbers with those of a key.
    pub fn check(&self, key: &str, found: &[f32]) {
        let expected = &self.array(key).data;
        assert_eq!(found.len(), expected.len(), "{key}");
        let difference = || found.iter().zip(expected).map(|(a, b)| f64::from(*a) - f64::from(*b));
        let magnitude = || expected.iter().map(|b| f64::from(*b));
        if self.exact_zeros.iter().any(|zero| zero == key) {
            let worst = largest(difference());
            assert!(worst <= 1e-4, "{key}: {worst:.2e}, where exact arithmetic gives 0");
            return;
        }
        let relative = |found: f64, of: f64| if of == 0.0 { found } else { found / of };
        let errors = [
            relative(length(difference()), length(magnitude())),
            relative(largest(difference()), largest(magnitude())),
        ];
        let budget = self.errors.get(key).unwrap_or_else(|| panic!("the file does not say what f32 costs {key}"));
        for (error, f32_error) in errors.iter().zip(budget) {
            let allowed = (20.0 * f32_error).max(1e-5);
            assert!(*error <= allowed, "{key}: relative errors {errors:?}, allowed {allowed:.2e}");
        }
    }

    /// Compares every parameter's gradient: in full where the file has it, else its norm, sum and a weighted sum.
    pub fn check_gradients(&self, params: &Params<f32>, tape: &Tape<f32>) {
        let mut compared = 0;
        for (id, param) in params.iter() {
            let name = param.name();
            let Some(stat) = self.arrays.get(&format!("gradstat.w.{name}")) else { continue };
            let gradient = tape.param_grad(id).unwrap_or_else(|| panic!("no gradient reached {name}"));
            let key = format!("grad.w.{name}");
            if self.arrays.contains_key(&key) {
                self.check(&key, &gradient);
            }
            let g = || gradient.iter().enumerate().map(|(i, g)| (i as f64, f64::from(*g)));
            let found = [
                g().map(|(_, g)| g * g).sum::<f64>().sqrt(),
                g().map(|(_, g)| g).sum(),
                g().map(|(i, g)| g * (0.7 * i + 0.3).cos()).sum(),
            ];
            let norm = f64::from(stat.data[0]);
            let zero = self.exact_zeros.iter().any(|zero| *zero == key || zero.ends_with(&format!("w.{name}")));
            for (found, expected) in found.iter().zip(&stat.data) {
                let error = (found - f64::from(*expected)).abs();
                let allowed = if zero { 1e-4 } else { (20.0 * self.gradstat_error).max(1e-5) * norm };
                assert!(error <= allowed, "gradient of {name}: {found} against {expected} (norm {norm})");
            }
            compared += 1;
        }
        let stats = self.arrays.keys().filter(|key| key.starts_with("gradstat.")).count();
        assert_eq!(compared, stats, "gradients compared, of those in the file");
    }
}

fn length(values: impl Iterator<Item = f64>) -> f64 {
    values.map(|x| x * x).sum::<f64>().sqrt()
}

/// The largest absolute value; NaN if there is one.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |max, x| if x.abs() > max || x.is_nan() { x.abs() } else { max })
}
