//! The published perceptual loss through the trainer, with drawn weights of VGG-19 from a file.

use crate::capture;
use std::path::Path;
use weaver_io::safetensors::Tensors;
use weaver_trainer::Session;
use weaver_two_experts::TwoExpertsRecipe;

type Config = weaver_trainer::Config<TwoExpertsRecipe>;

/// Index, outputs and inputs of the convolutions up to the fifth block.
const CONVOLUTIONS: [[usize; 3]; 14] = [
    [0, 64, 3],
    [2, 64, 64],
    [5, 128, 64],
    [7, 128, 128],
    [10, 256, 128],
    [12, 256, 256],
    [14, 256, 256],
    [16, 256, 256],
    [19, 512, 256],
    [21, 512, 512],
    [23, 512, 512],
    [25, 512, 512],
    [28, 512, 512],
    [30, 512, 512],
];

/// Writes weights of `count` convolutions: each output follows one input.
fn write(path: &Path, count: usize) {
    let mut tensors = Tensors::default();
    for [index, outputs, inputs] in &CONVOLUTIONS[..count] {
        let mut weight = vec![0.0_f32; outputs * inputs * 9];
        (0..*outputs).for_each(|output| weight[(output * inputs + output % inputs) * 9 + 4] = 1.0);
        tensors.insert(format!("features.{index}.weight"), &[*outputs, *inputs, 3, 3], weight);
        tensors.insert(format!("features.{index}.bias"), &[*outputs], vec![0.1_f32; *outputs]);
    }
    tensors.write(path).unwrap();
}

fn session(weights: &Path) -> Result<Session<TwoExpertsRecipe>, weaver_trainer::Error> {
    let file = format!("stages.1.losses.image.perceptual_weights={:?}", weights.display().to_string());
    let settings = ["stages.1.losses.image.perceptual=0.2".to_string(), file];
    let mut config = Config::resolve(Some("micro"), None, &settings).unwrap();
    config.data.folders = capture::folders();
    config.rescale(3);
    Session::new(config)
}

/// Promise of `drawn_weights_give_what_a_slow_twin_gives`.
#[test]
fn a_stage_is_trained_by_features_of_vgg19() {
    let folder = tempfile::tempdir().unwrap();
    let weights = folder.path().join("vgg19.safetensors");
    write(&weights, 14);
    let mut session = session(&weights).unwrap();
    let mut found = Vec::new();
    while let Some(report) = session.advance().unwrap() {
        found.push((report.stage.clone(), report.scalar("loss/perceptual")));
    }
    let (without, with): (Vec<_>, Vec<_>) = found.into_iter().partition(|(stage, _)| stage != "appearance");
    assert!(!with.is_empty() && with.iter().all(|(_, term)| term.is_some_and(|value| value > 0.0)));
    assert!(without.iter().all(|(_, term)| term.is_none()));
}

/// Promise of `drawn_weights_give_what_a_slow_twin_gives`.
#[test]
fn weights_of_another_network_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let weights = folder.path().join("vgg13.safetensors");
    write(&weights, 4);
    let message = session(&weights).unwrap_err().to_string();
    assert!(message.contains("vgg13.safetensors") && message.contains("`features.10.weight`"), "{message}");
    assert!(message.contains("expected a tensor of shape [256, 128, 3, 3], found none"), "{message}");
}
