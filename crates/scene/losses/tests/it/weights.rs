//! Weights of networks that are not part of the repository.

use safetensors::{Dtype, SafeTensors};
use std::path::{Path, PathBuf};
use weaver_losses::lpips::Tensors;

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
