//! Reference numbers from `tests/fixtures`, and how close to them is close enough.

use half::f16;
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
        let errors = &header.metadata().as_ref().unwrap()["f32_error"];
        let f32_error = serde_json::from_str(errors).unwrap();
        Self { bytes, f32_error }
    }

    pub fn tensor(&self, key: &str) -> (Vec<f32>, Vec<usize>) {
        let file = SafeTensors::deserialize(&self.bytes).unwrap();
        let tensor = file.tensor(key).unwrap();
        let numbers = match tensor.dtype() {
            Dtype::F32 => tensor.data().chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect(),
            Dtype::F16 => {
                tensor.data().chunks_exact(2).map(|b| f16::from_le_bytes(b.try_into().unwrap()).into()).collect()
            }
            other => panic!("{key}: numbers of type {other:?}"),
        };
        (numbers, tensor.shape().to_vec())
    }

    /// Relative L2 distance at most the larger of 1e-5 and twenty times what 32-bit arithmetic alone costs.
    #[track_caller]
    pub fn assert_close(&self, key: &str, found: &[f32]) {
        let (expected, _) = self.tensor(key);
        assert_eq!(found.len(), expected.len(), "{key}");
        let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|v| v * v).sum::<f64>().sqrt();
        let difference = norm(&mut found.iter().zip(&expected).map(|(f, e)| f64::from(*f) - f64::from(*e)));
        let error = difference / norm(&mut expected.iter().map(|e| f64::from(*e)));
        let allowed = (20.0 * self.f32_error[key][0].as_f64().unwrap()).max(1e-5);
        assert!(error <= allowed, "{key}: relative error {error:.2e}, allowed {allowed:.2e}");
    }
}
