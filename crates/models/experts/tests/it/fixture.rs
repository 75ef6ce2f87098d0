//! Reference numbers from `tests/fixtures`, and how close to them is close enough.

use half::f16;
use safetensors::{Dtype, SafeTensors};
use std::path::Path;

/// A file of reference numbers.
pub struct Fixture {
    bytes: Vec<u8>,
    errors: serde_json::Value,
    /// Error by single precision of the sums of a gradient, relative to its norm.
    pub gradstat_error: f64,
    exact_zeros: serde_json::Value,
}

impl Fixture {
    /// Reads a file of the repository.
    pub fn open(name: &str) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../tests/fixtures").join(name);
        let bytes = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        let metadata = header.metadata().as_ref().unwrap();
        let json = |key: &str| -> serde_json::Value { serde_json::from_str(&metadata[key]).unwrap() };
        let gradstat_error = json("f32_error_gradstat_max")[0].as_f64().unwrap();
        Self { errors: json("f32_error"), gradstat_error, exact_zeros: json("exact_zeros"), bytes }
    }

    /// Remainder in single precision of a gradient that vanishes in exact arithmetic; `None` for any other.
    pub fn exact_zero(&self, key: &str) -> Option<f64> {
        self.exact_zeros.get(key).map(|left| left.as_f64().unwrap())
    }

    /// The shape of a tensor.
    pub fn shape(&self, key: &str) -> Vec<usize> {
        SafeTensors::deserialize(&self.bytes).unwrap().tensor(key).unwrap().shape().to_vec()
    }

    /// A tensor of F32 or F16.
    pub fn f32(&self, key: &str) -> Vec<f32> {
        let file = SafeTensors::deserialize(&self.bytes).unwrap();
        let tensor = file.tensor(key).unwrap();
        match tensor.dtype() {
            Dtype::F32 => tensor.data().chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect(),
            Dtype::F16 => {
                tensor.data().chunks_exact(2).map(|b| f16::from_le_bytes(b.try_into().unwrap()).into()).collect()
            }
            other => panic!("{key}: numbers of type {other:?}"),
        }
    }

    /// A tensor of I32 that holds indices.
    pub fn indices(&self, key: &str) -> Vec<u32> {
        let file = SafeTensors::deserialize(&self.bytes).unwrap();
        let data = file.tensor(key).unwrap().data();
        data.chunks_exact(4).map(|b| i32::from_le_bytes(b.try_into().unwrap()) as u32).collect()
    }

    /// True if the file holds a tensor.
    pub fn has(&self, key: &str) -> bool {
        SafeTensors::deserialize(&self.bytes).unwrap().tensor(key).is_ok()
    }

    /// Panics unless `found` is within the larger of 1e-5 and 20 times the error that single precision makes, both in
    /// relative L2 and in largest error over largest value.
    #[track_caller]
    pub fn assert_close(&self, key: &str, found: &[f32]) {
        let allowed = self.errors.get(key).map_or([0.0; 2], |e| [0, 1].map(|i| e[i].as_f64().unwrap()));
        close(key, found, &self.f32(key), allowed.map(|e| (20.0 * e).max(1e-5)));
    }
}

/// Panics unless two tensors agree in relative L2 and in largest error over largest value.
#[track_caller]
pub fn close(what: &str, found: &[f32], expected: &[f32], allowed: [f64; 2]) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let largest =
        |v: &mut dyn Iterator<Item = f64>| v.fold(0.0, |a: f64, x| if x.is_nan() { x } else { a.max(x.abs()) });
    let norm = |v: &mut dyn Iterator<Item = f64>| v.map(|x| x * x).sum::<f64>().sqrt();
    let error = || found.iter().zip(expected).map(|(f, e)| f64::from(*f) - f64::from(*e));
    let value = || expected.iter().map(|e| f64::from(*e));
    let l2 = norm(&mut error()) / norm(&mut value());
    let max = largest(&mut error()) / largest(&mut value());
    assert!(l2 <= allowed[0] && max <= allowed[1], "{what}: errors {l2:.2e}, {max:.2e}, allowed {allowed:?}");
}

/// [V, C, H W] to [V H W, C].
pub fn to_rows(x: &[f32], views: usize, channels: usize) -> Vec<f32> {
    transpose_each(x, views, channels)
}

/// [n, a, b] to [n, b, a].
pub fn transpose_each(x: &[f32], n: usize, a: usize) -> Vec<f32> {
    let b = x.len() / (n * a);
    let mut out = vec![0.0; x.len()];
    for i in 0..n {
        for r in 0..a {
            for c in 0..b {
                out[(i * b + c) * a + r] = x[(i * a + r) * b + c];
            }
        }
    }
    out
}

/// Quaternions xyzw to wxyz.
pub fn w_first(x: &[f32]) -> Vec<f32> {
    x.chunks_exact(4).flat_map(|q| [q[3], q[0], q[1], q[2]]).collect()
}
