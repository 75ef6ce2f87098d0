//! Weights for inference only, in 16 bits.

use std::path::Path;
use weaver_inference::{Checkpoint, Error};

const WEIGHTS: &[u8] = include_bytes!("../../weights/tiny-endless.safetensors");

#[test]
fn compact_weights_are_their_own_compact_form() {
    let built_in = Checkpoint::from_bytes(WEIGHTS, Path::new("built in")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("again.safetensors");
    built_in.compact().unwrap().write(&path).unwrap();
    assert!(std::fs::read(&path).unwrap() == WEIGHTS);
    assert!(WEIGHTS.len() < 12_000_000, "{} bytes", WEIGHTS.len());
}

#[test]
fn damaged_weights_are_refused_by_name() {
    let half = Checkpoint::from_bytes(&WEIGHTS[..WEIGHTS.len() / 2], Path::new("half.safetensors"));
    let error = half.expect_err("half a file").to_string();
    assert!(error.contains("half.safetensors"), "{error}");
    let mut tensors = Checkpoint::from_bytes(WEIGHTS, Path::new("built in")).unwrap().tensors().clone();
    tensors.metadata.insert("format".into(), "other".into());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.safetensors");
    tensors.write(&path).unwrap();
    let error = Checkpoint::read(&path).expect_err("another format");
    assert!(matches!(error, Error::Checkpoint { .. }) && error.to_string().contains("other"), "{error}");
}
