//! Reference numbers from `tests/fixtures`, and how close to them is close enough.

use std::path::{Path, PathBuf};
use weaver_autograd::{Params, Shape, Tape, Var};
use weaver_io::safetensors::{TensorData, Tensors};

pub struct Fixture {
    tensors: Tensors,
    f32_error: serde_json::Value,
}

impl Fixture {
    pub fn open(name: &str) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../tests/fixtures").join(name);
        let tensors = Tensors::read(&path).unwrap();
        Self { f32_error: serde_json::from_str(&tensors.metadata["f32_error"]).unwrap(), tensors }
    }

    pub fn has(&self, key: &str) -> bool {
        self.tensors.tensors.contains_key(key)
    }

    pub fn keys(&self) -> impl Iterator<Item = &str> {
        self.tensors.tensors.keys().map(String::as_str)
    }

    pub fn shape(&self, key: &str) -> &[usize] {
        &self.tensors.get(key).unwrap().shape
    }

    pub fn numbers(&self, key: &str) -> Vec<f64> {
        match &self.tensors.get(key).unwrap().data {
            TensorData::F32(values) => values.iter().map(|x| f64::from(*x)).collect(),
            TensorData::I32(values) => values.iter().map(|x| f64::from(*x)).collect(),
            TensorData::U8(values) => values.iter().map(|x| f64::from(*x)).collect(),
            other => panic!("{key}: numbers of type {}", other.dtype()),
        }
    }

    pub fn constant<'t>(&self, tape: &'t Tape<f64>, key: &str) -> Var<'t, f64> {
        tape.constant(&self.numbers(key), Shape::new(self.shape(key)))
    }

    /// Overwrites every parameter with the file's `w.NAME`.
    pub fn load(&self, params: &mut Params<f64>) {
        for id in params.ids() {
            let key = format!("w.{}", params.get(id).name());
            assert_eq!(params.get(id).shape().dims(), self.shape(&key), "{key}");
            params.value_mut(id).copy_from_slice(&self.numbers(&key));
        }
        let weights = self.keys().filter(|key| key.starts_with("w.")).count();
        assert_eq!(params.len(), weights, "every weight of the file has a parameter");
    }

    /// Relative L2 distance at most the larger of 1e-6 and, for sums that cancel, what 32-bit arithmetic costs.
    #[track_caller]
    pub fn assert_close(&self, key: &str, found: &[f64]) {
        let expected = self.numbers(key);
        assert_eq!(found.len(), expected.len(), "{key}");
        let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|v| v * v).sum::<f64>().sqrt();
        let error = norm(&mut found.iter().zip(&expected).map(|(f, e)| f - e));
        let scale = norm(&mut expected.iter().copied());
        let allowed = self.f32_error[key][0].as_f64().unwrap_or(0.0).max(1e-6);
        assert!(error <= allowed * scale.max(1e-6), "{key}: error {error:.2e} of {scale:.2e}, allowed {allowed:.2e}");
    }

    /// Every gradient: in full where the file has it, and its norm, sum and weighted sum.
    pub fn assert_gradients(&self, params: &Params<f64>, tape: &Tape<f64>) {
        for (id, param) in params.iter() {
            let gradient = tape.param_grad(id).unwrap_or_else(|| panic!("{}: no gradient", param.name()));
            let full = format!("grad.w.{}", param.name());
            if self.has(&full) {
                self.assert_close(&full, &gradient);
            }
            let weighted = |i: usize, g: &f64| g * (0.7 * i as f64 + 0.3).cos();
            let statistics = [
                gradient.iter().map(|g| g * g).sum::<f64>().sqrt(),
                gradient.iter().sum(),
                gradient.iter().enumerate().map(|(i, g)| weighted(i, g)).sum(),
            ];
            self.assert_close(&format!("gradstat.w.{}", param.name()), &statistics);
        }
    }
}

/// The real annotation lists, where they are.
pub fn real_lists() -> Option<PathBuf> {
    let root = std::env::var_os("WEAVER_SHARED").map(PathBuf::from);
    let folder = root.map(|root| root.join("data/video-anomaly-labels")).filter(|folder| folder.is_dir());
    if folder.is_none() {
        println!("skipped: no data (video-anomaly-labels)");
    }
    folder
}
