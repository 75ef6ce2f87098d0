//! Reference numbers, on machines that have them.

use safetensors::SafeTensors;
use std::path::{Path, PathBuf};

/// A file of reference numbers.
pub struct Fixture {
    bytes: Vec<u8>,
    errors: serde_json::Value,
}

/// `shared/fixtures/<name>` in `WEAVER_SHARED`, or beside one of the folders above this crate.
fn find(name: &str) -> Option<PathBuf> {
    let roots = match std::env::var_os("WEAVER_SHARED") {
        Some(root) => vec![PathBuf::from(root)],
        None => Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|a| a.join("shared")).collect(),
    };
    roots.into_iter().map(|r| r.join("fixtures").join(name)).find(|p| p.exists())
}

impl Fixture {
    /// Reads a file; `None`, with a remark, where there is none.
    pub fn open(name: &str) -> Option<Self> {
        let Some(path) = find(name) else {
            println!("skipped: no data ({name})");
            return None;
        };
        let bytes = std::fs::read(path).unwrap();
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        let errors = serde_json::from_str(&header.metadata().as_ref().unwrap()["f32_error"]).unwrap();
        Some(Self { bytes, errors })
    }

    /// The shape of a tensor.
    pub fn shape(&self, key: &str) -> Vec<usize> {
        SafeTensors::deserialize(&self.bytes).unwrap().tensor(key).unwrap().shape().to_vec()
    }

    /// A tensor of F32.
    pub fn f32(&self, key: &str) -> Vec<f32> {
        let file = SafeTensors::deserialize(&self.bytes).unwrap();
        file.tensor(key).unwrap().data().chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
    }

    /// A tensor of I32 that holds indices.
    pub fn indices(&self, key: &str) -> Vec<u32> {
        let file = SafeTensors::deserialize(&self.bytes).unwrap();
        let data = file.tensor(key).unwrap().data();
        data.chunks_exact(4).map(|b| i32::from_le_bytes(b.try_into().unwrap()) as u32).collect()
    }

    /// Whether the file holds a tensor.
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
