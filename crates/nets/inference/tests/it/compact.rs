//! Weights for inference only, in 16 bits.

use half::f16;
use std::path::Path;
use weaver_inference::{Checkpoint, Error, SplatWeaverPredictor};

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

/// A network with a weight that is not finite would draw nothing, and its figures would pass for the network's own.
///
/// Promise (servers): weights of a run that are not finite are refused by name.
#[test]
fn weights_that_are_not_finite_are_refused() {
    let mut tensors = Checkpoint::from_bytes(WEIGHTS, Path::new("built in")).unwrap().tensors().clone();
    let key = tensors.tensors.keys().find(|key| key.ends_with("bias")).unwrap().clone();
    let shape = tensors.tensors[&key].shape.clone();
    for value in [f16::NAN, f16::INFINITY] {
        tensors.insert(&key, &shape, vec![value; shape.iter().product()]);
        let Err(error) = SplatWeaverPredictor::from_checkpoint(&Checkpoint::of(tensors.clone()).unwrap()) else {
            panic!("{key}: taken")
        };
        assert!(error.to_string().contains(&format!("tensor {key}: expected finite numbers, found")), "{error}");
    }
}
