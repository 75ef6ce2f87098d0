//! Masked pixels have no effect: not in training, not in allocation, not in evaluation.

use super::switch_off::{everything, reports};
use crate::capture;
use std::path::Path;
use weaver_autograd::{Params, Tape};
use weaver_data::{Layout, training_tuple};
use weaver_inference::{Photos, Predictor, SplatWeaverPredictor};
use weaver_kernels::random::Stream;
use weaver_model::SplatWeaver;
use weaver_procedural::{ProceduralOptions, scene};
use weaver_router::AllocationKind;
use weaver_trainer::evaluate::{Options, evaluate};
use weaver_trainer::losses::{ImageLosses, ImageNetworks, Terms};
use weaver_trainer::splatweaver::SplatWeaverRecipe;
use weaver_trainer::{Example, Recipe, Session, scenes};

type Config = weaver_trainer::Config<SplatWeaverRecipe>;

/// A capture with the right part of each photo masked and full of garbage.
fn captured(folder: &Path, garbage: f32) {
    let mut truth = scene(3, &ProceduralOptions { width: 40, height: 32, views: 9 });
    std::fs::create_dir_all(folder.join("masks")).unwrap();
    for (view, photo) in truth.views.iter_mut().enumerate() {
        let mut mask = photo.image.clone();
        for (i, (color, mask)) in photo.image.pixels.chunks_mut(3).zip(mask.pixels.chunks_mut(3)).enumerate() {
            let inside = i % 40 < 22 + view % 3;
            mask.fill(f32::from(inside));
            if !inside {
                color.fill((garbage * i as f32).fract());
            }
        }
        mask.write_png(folder.join(format!("masks/{view}.png"))).unwrap();
    }
    capture::write(&truth, folder);
}

fn on(folder: &Path, masks: bool, steps: usize, settings: &[&str]) -> Config {
    let mut config = everything(steps, settings);
    config.data.folders = vec![folder.to_path_buf()];
    config.data.masks = masks;
    config
}

/// Losses on everything, with the router's own choice.
const ALL: [&str; 6] = [
    "stages.1.model.allocation=sampled",
    "stages.1.losses.router.rank=0.01",
    "stages.1.losses.router.budget=0.01",
    "stages.1.losses.depth.rendered=0.1",
    "stages.1.losses.pose.huber=1",
    "stages.1.losses.image.ssim=0.15",
];

fn trained(config: Config) -> String {
    let mut session = Session::new(config).unwrap();
    while session.advance().unwrap().is_some() {}
    session.checksum()
}

/// Garbage that is masked changes no bit of training nor of evaluation.
///
/// Promise (photos): masked pixels change no bit of training, inference or evaluation, and get no Gaussian.
#[test]
fn masked_garbage_changes_no_bit() {
    let folders = [0.37, 0.91].map(|garbage| {
        let folder = tempfile::tempdir().unwrap();
        captured(folder.path(), garbage);
        folder
    });
    for settings in [&[][..], &ALL] {
        let [first, second] = folders.each_ref().map(|folder| trained(on(folder.path(), true, 2, settings)));
        assert_eq!(first, second, "{settings:?}");
    }
    // Where it is not masked, it does.
    let [first, second] = folders.each_ref().map(|folder| trained(on(folder.path(), false, 2, &[])));
    assert_ne!(first, second);

    let options = Options { context_views: 2, ..Options::default() };
    let figures = |folder: &Path, masks: bool| {
        let config = on(folder, masks, 1, &[]);
        let scenes = scenes::load(&config.data, SplatWeaverRecipe::image_size(&config.model)).unwrap();
        let mut params = Params::new();
        let model = SplatWeaver::new(config.model.clone(), &mut params, 0);
        let mut predictor = SplatWeaverPredictor::new(model, params, AllocationKind::Grid, 0.4);
        let found = evaluate(&mut predictor, &scenes, &options, None, &mut |_, _| {}).unwrap().mean;
        [found.psnr, found.psnr_energetic, found.ssim, found.psnr_nearest, found.psnr_mean_color]
    };
    let [first, second] = folders.each_ref().map(|folder| figures(folder.path(), true));
    assert!(first == second && first.iter().all(|figure| figure.is_finite()), "{first:?} {second:?}");
    let [first, second] = folders.each_ref().map(|folder| figures(folder.path(), false));
    assert!(first.iter().zip(&second).all(|(a, b)| a != b), "{first:?} {second:?}");
}

/// Promise of `masked_garbage_changes_no_bit`.
#[test]
fn no_gaussian_comes_from_a_pixel_outside() {
    let folder = tempfile::tempdir().unwrap();
    captured(folder.path(), 0.5);
    let config = on(folder.path(), true, 1, &[]);
    let (d, m) = (&config.data, &config.model);
    let scenes = scenes::load(d, SplatWeaverRecipe::image_size(m)).unwrap();
    let layouts: Vec<Layout> = scenes.iter().map(Layout::of).collect();
    let tuple = training_tuple(&layouts, Stream::new(0, 0, "tuples"), 0, d.pool, d.context_views, d.target_views);
    let example = Example::new(&scenes[0], &layouts[0], tuple).unwrap();
    let photos = example.context_photos();
    let inside = photos.inside.unwrap();
    assert!(inside.contains(&true) && inside.contains(&false));
    let mut params = Params::new();
    let model = SplatWeaver::new(m.clone(), &mut params, 0);
    let mut predictor = SplatWeaverPredictor::new(model, params, AllocationKind::Grid, 0.4);
    let mut counts = |name: &str, photos: Photos<'_>| {
        let density = weaver_inference::Density { allocation: Some(name.parse().unwrap()), budget: None };
        let given = weaver_inference::CameraSource::Given(example.context());
        predictor.predict(photos, given, density, Stream::new(0, 0, "test")).unwrap().counts
    };
    for name in ["grid", "dithered", "random", "sampled", "fixed:2"] {
        let found = counts(name, photos);
        assert!(found.iter().zip(inside).all(|(count, inside)| *inside || *count == 0), "{name}");
        assert!(found.iter().any(|count| *count > 0), "{name}");
        let free = counts(name, Photos { inside: None, ..photos });
        assert!(free.iter().zip(inside).any(|(count, inside)| !inside && *count > 0), "{name}");
    }
    // In training: every pixel inside gets two, and none outside.
    let report = &reports(on(folder.path(), true, 1, &["stages.1.model.allocation=fixed:2"]))[0];
    let share = inside.iter().filter(|inside| **inside).count() as f32 / inside.len() as f32;
    let count = report.scalar("gaussians_per_pixel").unwrap() as f32;
    assert!((count - 2.0 * share).abs() < 0.1, "{count} {share}");
}

/// Image losses have no gradient outside and are per pixel inside.
#[test]
fn image_losses_stay_inside_masks() {
    let weights = ImageLosses { mse: 1.0, ssim: 0.5, ..ImageLosses::default() };
    let shape = [2, 3, 16, 16];
    let inside: Vec<bool> = (0..512).map(|i| i % 16 < 4).collect();
    let of_plane = |i: usize| (i / 768) * 256 + i % 256;
    let stream = Stream::new(1, 0, "images");
    let truth: Vec<f32> = (0..1536).map(|i| stream.uniform(i)).collect();
    let found = |fill: f32| {
        let tape = Tape::new();
        let image: Vec<f32> =
            (0..1536).map(|i| if inside[of_plane(i)] { stream.fork(1).uniform(i as u64) } else { fill }).collect();
        let (image, truth) = (tape.leaf(&image, shape), tape.constant(&truth, shape));
        let mut terms = Terms::default();
        weights.add(&mut terms, 1.0, &ImageNetworks::default(), [image, truth], Some(&inside));
        let total = terms.total().unwrap();
        total.backward();
        let values: Vec<f32> = terms.values().map(|(_, value)| value).collect();
        (values, image.grad().unwrap())
    };
    let ((values, gradient), (others, _)) = (found(0.0), found(0.9));
    assert_eq!(values, others);
    let flows = |i: usize| gradient[i] != 0.0;
    assert!((0..1536).all(|i| flows(i) == inside[of_plane(i)]));
    let difference = |i: usize| (truth[i] - stream.fork(1).uniform::<f32>(i as u64)).powi(2);
    let expected = (0..1536).filter(|i| inside[of_plane(*i)]).map(difference).sum::<f32>() / 384.0;
    assert!((values[0] - expected).abs() < 1e-5, "{} {expected}", values[0]);
}

#[test]
fn masks_and_teachers_without_captures_are_refused() {
    for key in ["masks=true", "teacher=model.safetensors"] {
        let mut config = Config::resolve(Some("micro"), None, &[format!("data.{key}")]).unwrap();
        let message = Session::new(config.clone()).expect_err("an error").to_string();
        let name = key.split('=').next().unwrap();
        assert!(message.contains(&format!("data.{name}: expected")) && message.contains("data.folders"), "{message}");
        config.data.folders = vec!["capture".into()];
        assert!(config.check().is_ok());
    }
}
