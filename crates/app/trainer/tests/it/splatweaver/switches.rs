//! Every switch of the model and of its training takes effect, and trains.

use super::switch_off::{everything, reports};
use crate::capture;
use std::sync::LazyLock;
use weaver_autograd::{Params, Tape};
use weaver_data::{Layout, Scene, training_tuple};
use weaver_kernels::random::Stream;
use weaver_model::{ParametrizationConfig, SplatWeaver};
use weaver_nn::Context;
use weaver_pose::unproject;
use weaver_router::AllocationKind;
use weaver_trainer::splatweaver::{SplatWeaverRecipe, StageAllocation};
use weaver_trainer::{Example, Recipe, scenes};
use weaver_wavelet::{Wavelet, energy};

/// Result of an untrained model on one tuple, with a choice of Gaussians per pixel.
#[derive(Debug)]
struct Seen {
    /// Names of the parameters.
    names: Vec<String>,
    /// Wavelet energy of the model, and as computed with each of the two wavelets.
    energy: Vec<f32>,
    haar: Vec<f32>,
    db2: Vec<f32>,
    logits: Vec<f32>,
    expert: Vec<u8>,
    /// True if the router's choice has a gradient, and noise.
    gate: Option<bool>,
    /// The first camera's emitted code.
    first: Vec<f32>,
    /// Largest scale of a Gaussian; its largest offset from its pixel's point, in world units and in footprints.
    scale: f32,
    offset: f32,
    footprints: f32,
}

/// The scenes of a run, which no switch of the model changes.
static SCENES: LazyLock<(Vec<Scene>, Vec<Layout>)> = LazyLock::new(|| {
    let config = everything(1, &[]);
    let scenes = scenes::load(&config.data, SplatWeaverRecipe::image_size(&config.model)).unwrap();
    let layouts = scenes.iter().map(Layout::of).collect();
    (scenes, layouts)
});

fn seen(settings: &[&str], allocation: &str, budget: f64) -> Seen {
    let config = everything(1, settings);
    let (m, d) = (&config.model, &config.data);
    let (scenes, layouts) = &*SCENES;
    let tuple = training_tuple(layouts, Stream::new(0, 0, "tuples"), 0, d.pool, d.context_views, d.target_views);
    let example = Example::new(&scenes[tuple.scene], &layouts[tuple.scene], tuple).unwrap();
    let mut params = Params::new();
    let model = SplatWeaver::new(m.clone(), &mut params, 0);
    let tape = Tape::new();
    let cx = Context::new(&tape, &params);
    let planes = [d.context_views, 3, m.height, m.width];
    let photos = tape.constant(example.context_photos().planes, planes);
    let encoded = model.encode(cx, photos.reshape([1, planes[0], 3, m.height, m.width]));
    let dense = model.dense(cx, &encoded, 0, photos);
    let cameras = encoded.scene_cameras(0);
    let kind: AllocationKind = allocation.parse().unwrap();
    let chosen = kind.allocation(budget, m.gaussians.experts()).unwrap();
    let predicted = model.gaussians(cx, &dense, photos, &cameras, &*chosen, Stream::new(0, 0, "allocation"));
    let offset = if m.dense.pixel_point == weaver_model::PixelPoint::Center { 0.5 } else { 0.0 };
    let points = unproject(dense.depth, cameras.viewmats, cameras.intrinsics, offset).to_vec();
    let (depth, means) = (dense.depth.to_vec(), predicted.gaussians.means.to_vec());
    let focal = cameras.intrinsics.to_vec();
    let (mut farthest, mut footprints) = (0.0_f32, 0.0_f32);
    for (mean, &pixel) in means.chunks_exact(3).zip(predicted.pixel.iter()) {
        let pixel = pixel as usize;
        let footprint = depth[pixel] / focal[4 * (pixel / (m.height * m.width))];
        for (mean, point) in mean.iter().zip(&points[3 * pixel..]) {
            farthest = farthest.max((mean - point).abs());
            footprints = footprints.max((mean - point).abs() / footprint);
        }
    }
    Seen {
        names: params.iter().map(|(_, param)| param.name().to_string()).collect(),
        energy: dense.energy.to_vec(),
        haar: energy(photos, Wavelet::Haar).to_vec(),
        db2: energy(photos, Wavelet::Db2).to_vec(),
        logits: dense.logits.to_vec(),
        expert: predicted.assignment.expert.to_vec(),
        gate: predicted.assignment.gate.as_ref().map(|gate| gate.noise.is_some()),
        first: encoded.codes.last().unwrap().to_vec()[..7].to_vec(),
        scale: predicted.gaussians.scales.to_vec().into_iter().fold(0.0, f32::max),
        offset: farthest,
        footprints,
    }
}

/// The last loss and Gaussians per pixel of a run without any setting.
static USUAL: LazyLock<(f32, f32)> = LazyLock::new(|| trains(&[]));

/// Trains three steps, and returns the last loss and Gaussians per pixel.
#[track_caller]
fn trains(settings: &[&str]) -> (f32, f32) {
    let found = reports(everything(3, settings));
    assert_eq!(found.len(), 3);
    for report in &found {
        let finite = report.scalars.iter().all(|scalar| scalar.value.is_finite());
        assert!(
            finite && report.loss.is_finite() && report.scalar("gradient_norm") > Some(0.0),
            "{settings:?}: {report:?}"
        );
    }
    (found[2].loss as f32, found[2].scalar("gaussians_per_pixel").unwrap() as f32)
}

/// The frequency prior is the router's only input from wavelets.
///
/// Promise of `terms_are_there_where_they_have_a_weight`.
#[test]
fn the_frequency_prior_feeds_the_router() {
    let setting = |on: bool| format!("model.gaussians.frequency_prior={on}");
    let [off, on] = [false, true].map(|on| seen(&[&setting(on)], "argmax", 1.0));
    let has_prior = |seen: &Seen| seen.names.iter().any(|name| name.contains("wave_merger"));
    assert_eq!((has_prior(&off), has_prior(&on)), (false, true));
    assert_eq!(off.energy, on.energy);
    // Both routers see the same features, but for the prior.
    assert_ne!(off.logits, on.logits);
    assert_ne!(trains(&[&setting(false)]).0, trains(&[&setting(true)]).0);
}

/// Comparing the views starts without effect and learns.
#[test]
fn comparing_views_starts_without_effect() {
    let stereo = "model.dense.stereo={channels=2,hidden=4,depths=5,reach=1.5}";
    let [off, on] = [&[][..], &[stereo][..]].map(|settings| seen(settings, "argmax", 1.0));
    let more: Vec<&String> = on.names.iter().filter(|name| !off.names.contains(name)).collect();
    assert_eq!(more.len(), 10);
    assert!(more.iter().all(|name| name.starts_with("stereo.")), "{more:?}");
    assert_eq!((&off.logits, off.scale, off.offset), (&on.logits, on.scale, on.offset));
    assert_ne!(USUAL.0, trains(&[stereo]).0);
    // A stage of poses alone, which leaves it untrained, comes first.
    let mut config =
        weaver_trainer::Config::<SplatWeaverRecipe>::resolve(Some("micro"), None, &[stereo.into()]).unwrap();
    config.data.folders = capture::folders();
    config.stages.iter_mut().for_each(|stage| stage.steps = 2);
    assert_eq!(reports(config).len(), 4);
}

/// Cells get a budget in training and experts above the first.
#[test]
fn cells_get_budgets_and_later_experts() {
    let patch = "model.gaussians.parametrization={kind=\"patch\",offset_reach=2.0,scale=0.7}";
    let allocation = |name: &str| format!("stages.1.model.allocation={name}");
    let budget = "stages.1.model.budget=0.125";
    assert_eq!(trains(&[patch, &allocation("quadtree"), budget]).1, 0.125);
    for mix in ["quadtree-mix", "quadtree-grid-mix"] {
        let (_, count) = trains(&[patch, &allocation(mix)]);
        assert!((0.004..=3.0).contains(&count), "{mix}: {count}");
    }
    let sparse = seen(&[patch], "quadtree", 0.05);
    assert_eq!(sparse.expert.iter().map(|e| usize::from(*e)).sum::<usize>(), (0.05 * 2048.0) as usize);
    assert!(sparse.expert.contains(&2) && sparse.gate.is_none(), "some cells get two");
}

#[test]
fn the_neighbor_attention_is_there_or_not() {
    let setting = |on: bool| format!("model.gaussians.neighbor_attention={on}");
    let [off, on] = [false, true].map(|on| seen(&[&setting(on)], "argmax", 1.0));
    let more: Vec<&String> = on.names.iter().filter(|name| !off.names.contains(name)).collect();
    assert!(!more.is_empty() && more.iter().all(|name| name.contains("gs_moe")), "{more:?}");
    assert!(off.names.iter().all(|name| on.names.contains(name)) || off.names.len() < on.names.len());
    assert_ne!(trains(&[&setting(false)]).0, trains(&[&setting(true)]).0);
}

#[test]
fn energy_is_that_of_the_wavelet() {
    let [haar, db2] = ["haar", "db2"].map(|kind| seen(&[&format!("model.gaussians.wavelet={kind}")], "argmax", 1.0));
    let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
    assert!(near(&haar.energy, &haar.haar) && near(&db2.energy, &db2.db2));
    assert!(!near(&haar.energy, &db2.energy));
    assert_ne!(trains(&["model.gaussians.wavelet=haar"]).0, trains(&["model.gaussians.wavelet=db2"]).0);
}

/// Offsets and scales follow the parametrization.
///
/// Promise of `terms_are_there_where_they_have_a_weight`.
#[test]
fn offsets_and_scales_follow_the_parametrization() {
    // Strong experts, so that bounds are reached.
    let strong = "model.gaussians.expert_gain=50";
    let published = |reach: f64, most: f64| {
        let kind = format!(
            "model.gaussians.parametrization={{ kind = \"published\", offset_reach = {reach}, scale_multiplier = 0.007, scale_max = {most} }}"
        );
        let found = seen(&[strong, &kind], "fixed:2", 1.0);
        assert!(trains(&[&kind]).0 > 0.0);
        found
    };
    for (reach, most) in [(0.035, 0.01), (0.2, 0.004)] {
        let found = published(reach, most);
        assert!((f64::from(found.offset) - reach).abs() < 0.2 * reach, "offset {} of {reach}", found.offset);
        assert!((f64::from(found.scale) - most).abs() < 1e-6, "scale {} of {most}", found.scale);
    }
    for reach in [0.5, 2.0] {
        let kind =
            format!("model.gaussians.parametrization={{ kind = \"footprint\", offset_reach = {reach}, scale = 0.7 }}");
        let found = seen(&[strong, &kind], "fixed:2", 1.0);
        assert!((f64::from(found.footprints) - reach).abs() < 0.2 * reach, "{} of {reach}", found.footprints);
    }
    let config = everything(1, &["model.gaussians.parametrization.kind=footprint"]);
    assert!(matches!(config.model.gaussians.parametrization, ParametrizationConfig::Footprint { .. }));
    trains(&["model.gaussians.parametrization.kind=footprint"]);
}

/// The pose frame is the first cameras or the networks.
#[test]
fn the_pose_frame_has_two_choices() {
    let [network, first] =
        ["network", "first-camera"].map(|kind| seen(&[&format!("model.camera.pose_frame={kind}")], "argmax", 1.0));
    let identity = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let apart = |code: &[f32]| code.iter().zip(&identity).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(apart(&first.first) < 1e-5 && apart(&network.first) > 1e-3, "{:?} {:?}", first.first, network.first);
    assert_ne!(trains(&["model.camera.pose_frame=network"]).0, trains(&["model.camera.pose_frame=first-camera"]).0);
}

#[test]
fn a_fixed_allocation_gives_each_pixel_so_many() {
    for count in 0..3_u8 {
        let kind = format!("fixed:{count}");
        assert!(seen(&[], &kind, 1.0).expert.iter().all(|expert| *expert == count));
        assert_eq!(trains(&[&format!("stages.1.model.allocation={kind}")]).1, f32::from(count));
    }
}

#[test]
fn the_router_allocates_with_noise_or_without() {
    let [argmax, sampled] = ["argmax", "sampled"].map(|kind| seen(&[], kind, 1.0));
    assert_eq!((argmax.gate, sampled.gate), (Some(false), Some(true)));
    for (row, expert) in argmax.logits.chunks_exact(4).zip(&argmax.expert) {
        assert!(row.iter().all(|logit| *logit <= row[usize::from(*expert)]), "{row:?}: {expert}");
    }
    assert_ne!(argmax.expert, sampled.expert);
    let trained = ["argmax", "sampled"].map(|kind| trains(&[&format!("stages.1.model.allocation={kind}")]).0);
    assert_ne!(trained[0], trained[1]);
}

/// Promise of `every_form_of_the_budget_trains`.
#[test]
fn allocations_with_a_budget_keep_it_each_in_its_way() {
    let kinds = ["dithered", "grid", "random"];
    let mut losses = Vec::new();
    for kind in kinds {
        for budget in [0.2, 0.5] {
            let found = seen(&[], kind, budget);
            let mean = found.expert.iter().map(|e| f64::from(*e)).sum::<f64>() / found.expert.len() as f64;
            assert!(found.gate.is_none() && (mean - budget).abs() < 0.05, "{kind}: {mean} of {budget}");
        }
        let (loss, count) = trains(&[&format!("stages.1.model.allocation={kind}"), "stages.1.model.budget=0.5"]);
        assert!((count - 0.5).abs() < 0.05, "{kind}: {count}");
        losses.push(loss);
    }
    losses.sort_by(f32::total_cmp);
    losses.dedup();
    assert_eq!(losses.len(), 3, "each its own pixels");
}

#[test]
fn the_mix_draws_of_the_budgets_that_it_is_given() {
    let config = everything(12, &["stages.1.model.dense=0", "stages.1.model.budgets=[0.125, 0.5]"]);
    let counts: Vec<f32> =
        reports(config).iter().map(|report| report.scalar("gaussians_per_pixel").unwrap() as f32).collect();
    let near = |budget: f32| counts.iter().filter(|count| (*count - budget).abs() < 0.01).count();
    assert!(near(0.125) > 0 && near(0.5) > 0 && near(0.125) + near(0.5) == 12, "{counts:?}");
}

/// Promise (options): a switch changes the part that it names.
#[test]
fn terms_are_there_where_they_have_a_weight() {
    let sampled = "stages.1.model.allocation=sampled";
    let found = |settings: &[&str]| -> Vec<String> {
        let config = everything(1, settings);
        assert_eq!(config.stages[0].model.allocation, StageAllocation::Kind(AllocationKind::Sampled));
        reports(config)[0].group("loss").map(|(name, _)| name.to_string()).collect()
    };
    let plain = found(&[sampled]);
    let with = found(&[
        sampled,
        "stages.1.losses.router.budget=0.01",
        "stages.1.losses.router.rank=0.01",
        "stages.1.losses.depth.rendered=0.1",
        "stages.1.losses.pose.huber=1",
    ]);
    let mut more: Vec<&String> = with.iter().filter(|name| !plain.contains(name)).collect();
    more.sort();
    assert_eq!(more, ["budget", "pose_huber", "rank", "rendered_depth"]);
    let without = found(&[
        sampled,
        "stages.1.losses.image.mse=0",
        "stages.1.losses.router.error_regression=0",
        "stages.1.losses.router.rank=0.01",
    ]);
    let mut gone: Vec<&String> = plain.iter().filter(|name| !without.contains(name)).collect();
    gone.sort();
    assert_eq!(gone, ["error_regression", "mse"]);
    assert!(without.contains(&"rank".to_string()) && !without.contains(&"budget".to_string()));
}
