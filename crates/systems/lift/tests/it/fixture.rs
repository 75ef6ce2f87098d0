//! Reference numbers from `tests/fixtures`, and how close to them is close enough.

use safetensors::{Dtype, SafeTensors};
use std::path::Path;

pub struct Fixture {
    bytes: Vec<u8>,
    f32_error: serde_json::Value,
}

impl Fixture {
    pub fn open(name: &str) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../tests/fixtures").join(name);
        let bytes = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        let errors = header.metadata().as_ref().and_then(|metadata| metadata.get("f32_error").cloned());
        Self { bytes, f32_error: serde_json::from_str(&errors.unwrap_or("{}".into())).unwrap() }
    }

    pub fn numbers(&self, key: &str) -> Vec<f64> {
        let file = SafeTensors::deserialize(&self.bytes).unwrap();
        let tensor = file.tensor(key).unwrap();
        let words = tensor.data().as_chunks().0.iter().copied();
        match tensor.dtype() {
            Dtype::F32 => words.map(|b| f64::from(f32::from_le_bytes(b))).collect(),
            Dtype::I32 => words.map(|b| f64::from(i32::from_le_bytes(b))).collect(),
            other => panic!("{key}: numbers of type {other:?}"),
        }
    }

    /// Relative L2 distance at most the larger of 1e-5 and twenty times what 32-bit arithmetic alone costs.
    #[track_caller]
    pub fn assert_close(&self, key: &str, found: &[f64]) {
        let expected = self.numbers(key);
        assert_eq!(found.len(), expected.len(), "{key}");
        let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|v| v * v).sum::<f64>().sqrt();
        let error = norm(&mut found.iter().zip(&expected).map(|(f, e)| f - e)) / norm(&mut expected.iter().copied());
        let allowed = (20.0 * self.f32_error[key][0].as_f64().unwrap_or(0.0)).max(1e-5);
        assert!(error <= allowed, "{key}: relative error {error:.2e}, allowed {allowed:.2e}");
    }
}
