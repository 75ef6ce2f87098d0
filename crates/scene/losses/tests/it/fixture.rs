//! Reference numbers from `tests/fixtures`, and how close to them is close enough.

use safetensors::{Dtype, SafeTensors};
use std::path::{Path, PathBuf};
use weaver_losses::lpips::Tensors;

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

    /// The shape and the numbers of a tensor, whatever their type.
    pub fn tensor(&self, key: &str) -> (Vec<f32>, Vec<usize>) {
        let file = SafeTensors::deserialize(&self.bytes).unwrap();
        let tensor = file.tensor(key).unwrap();
        let words = tensor.data().chunks_exact(4).map(|b| <[u8; 4]>::try_from(b).unwrap());
        let numbers = match tensor.dtype() {
            Dtype::F32 => words.map(f32::from_le_bytes).collect(),
            Dtype::I32 => words.map(|b| i32::from_le_bytes(b) as f32).collect(),
            Dtype::U8 => tensor.data().iter().map(|b| f32::from(*b)).collect(),
            other => panic!("{key}: numbers of type {other:?}"),
        };
        (numbers, tensor.shape().to_vec())
    }

    pub fn data(&self, key: &str) -> Vec<f32> {
        self.tensor(key).0
    }

    /// Relative L2 distance at most the larger of 1e-5 and twenty times what 32-bit arithmetic alone costs.
    #[track_caller]
    pub fn assert_close(&self, key: &str, found: &[f32]) {
        let expected = self.data(key);
        assert_eq!(found.len(), expected.len(), "{key}");
        let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|v| v * v).sum::<f64>().sqrt();
        let difference = norm(&mut found.iter().zip(&expected).map(|(f, e)| f64::from(*f) - f64::from(*e)));
        let error = difference / norm(&mut expected.iter().map(|e| f64::from(*e))).max(f64::MIN_POSITIVE);
        let allowed = (20.0 * self.f32_error[key][0].as_f64().unwrap()).max(1e-5);
        assert!(error <= allowed, "{key}: relative error {error:.2e}, allowed {allowed:.2e}");
    }
}

/// A folder of data that is not part of the repository: in `$WEAVER_SHARED`, or in a folder `shared` beside or above.
fn shared(name: &str) -> Option<PathBuf> {
    let named = std::env::var_os("WEAVER_SHARED").map(PathBuf::from);
    let above = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|folder| folder.join("shared"));
    named.into_iter().chain(above).map(|folder| folder.join(name)).find(|path| path.exists())
}

/// The tensors of a half-precision weight file, if it is there.
pub fn weights(name: &str) -> Option<Tensors> {
    let Some(path) = shared("weights").map(|folder| folder.join(name)).filter(|path| path.exists()) else {
        println!("skipped: no data ({name})");
        return None;
    };
    let bytes = std::fs::read(path).unwrap();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let widen = |b: &[u8]| half::f16::from_le_bytes(b.try_into().unwrap()).to_f32();
    let tensor = |(key, view): (String, safetensors::tensor::TensorView<'_>)| {
        assert_eq!(view.dtype(), Dtype::F16, "{key}");
        (key, (view.shape().to_vec(), view.data().chunks_exact(2).map(widen).collect()))
    };
    Some(file.tensors().into_iter().map(tensor).collect())
}
