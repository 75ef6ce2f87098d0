//! Detectors in files.

use weaver_io::safetensors::Tensors;
use weaver_vad::{Detector, EncoderKind, Features, UrDmuSizes};

/// The public weights: names and shapes of UR-DMU at width 128, one head, and nothing else in the file.
fn public() -> Tensors {
    let sizes = UrDmuSizes { width: 128, heads: 1, hidden: 128, score_hidden: 32, ..UrDmuSizes::published(24) };
    let detector = Detector::new(EncoderKind::UrDmu(sizes), 5);
    let mut tensors = Tensors::default();
    for (_, param) in detector.params().iter() {
        tensors.insert(param.name(), param.shape().dims(), param.value().to_vec());
    }
    tensors
}

/// Public weights are read without further settings.
///
/// Promise (results): weights of the public UR-DMU are read as they are; files that do not fit are refused with the
/// weight.
#[test]
fn public_weights_are_read_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("urdmu.safetensors");
    public().write(&path).unwrap();
    let (detector, told) = Detector::read(&path).unwrap();
    let EncoderKind::UrDmu(sizes) = detector.kind() else { panic!("{:?}", detector.kind()) };
    assert_eq!((sizes.heads, sizes.head, sizes.memory, sizes.layers, told.as_str()), (1, 128, 60, 2, ""));
    let curves = detector.curves(&Features::in_memory(vec![0.1; 7 * 24], 24)).unwrap();
    assert!(curves.scores().len() == 7 && curves.scores().iter().all(|s| (0.0..1.0).contains(s)));
}

/// Promise of `public_weights_are_read_as_they_are`.
#[test]
fn other_files_are_refused_with_the_weight() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("urdmu.safetensors");
    let refused = |change: &dyn Fn(&mut Tensors)| {
        let mut tensors = public();
        change(&mut tensors);
        tensors.write(&path).unwrap();
        Detector::read(&path).unwrap_err().to_string()
    };
    let missing = refused(&|t| drop(t.tensors.remove("encoder_mu.0.bias")));
    assert!(missing.contains("encoder_mu.0.bias"), "{missing}");
    let more = refused(&|t| t.insert("another.weight", &[1], vec![0.0_f32]));
    assert!(more.contains("also another.weight"), "{more}");
    let shape = refused(&|t| t.insert("cls_head.mlp.2.weight", &[2, 32], vec![0.0_f32; 64]));
    assert!(shape.contains("cls_head.mlp.2.weight: expected [1, 32], found [2, 32]"), "{shape}");
    let nan = refused(&|t| t.insert("encoder_mu.0.bias", &[128], vec![f32::NAN; 128]));
    assert!(nan.contains("expected finite numbers"), "{nan}");
    let rank = refused(&|t| t.insert("embedding.conv_1.0.weight", &[2], vec![0.0_f32; 2]));
    assert!(rank.contains("expected 3 dimensions"), "{rank}");
    let kind = refused(&|t| drop(t.metadata.insert("vad.encoder".into(), "other".into())));
    assert!(kind.contains("expected urdmu"), "{kind}");
}
