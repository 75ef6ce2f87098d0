//! The whole model: images to cameras, Gaussians, renders and losses, and all the way back.

use super::camera_head::check_cameras;
use super::gaussian_head::{Recorded, color_major, maps, xyzw};
use super::metrics::lpips;
use super::reference::Reference;
use std::path::Path;
use weaver_autograd::{Params, Pool, Real, Tape, Var};
use weaver_experts::Neighbors;
use weaver_kernels::random::Stream;
use weaver_losses as losses;
use weaver_losses::lpips::Network;
use weaver_model::{
    BackboneConfig, CameraConfig, DenseConfig, GaussianConfig, ModelConfig, ParametrizationConfig, SplatWeaver,
};
use weaver_nn::Context;
use weaver_pose::CameraVars;
use weaver_splat::{GaussianVars, Rasterize, WorkspacePool};

/// The published network in the sizes of a file.
fn config(file: &Reference) -> ModelConfig {
    let published = ModelConfig::splatweaver_1b();
    let layers = file.sizes("layers_to_dpt").try_into().expect("four levels");
    let out_channels = file.sizes("gaussian_head.out_channels");
    assert_eq!(out_channels, file.sizes("depth_head.out_channels"), "both dense heads have the same levels");
    let head = |name: &str| file.size(&format!("gaussian_head.{name}"));
    ModelConfig {
        width: file.size("image_w"),
        height: file.size("image_h"),
        patch: file.size("patch"),
        backbone: BackboneConfig {
            dim: file.size("dim"),
            encoder_heads: file.size("heads"),
            encoder_depth: file.size("dino_depth"),
            heads: file.size("heads"),
            rounds: file.size("rounds"),
            registers: file.size("register_tokens"),
            position_table: Some(file.grid("pos_table")),
            ..published.backbone
        },
        camera: CameraConfig {
            heads: file.size("camera.heads"),
            depth: file.size("camera.trunk"),
            iterations: file.size("camera.iterations"),
            ..published.camera
        },
        dense: DenseConfig {
            layers,
            out_channels: out_channels.try_into().expect("four levels"),
            features: head("features"),
            depth_features: Some(file.size("depth_head.features")),
            channels: head("feature_channels"),
            depth_hidden: file.shape("w.depth_head.scratch.output_conv2.0.weight")[0],
            image_skip_hidden: head("merger_hidden"),
            guidance_hidden: head("wave_hidden"),
            ..published.dense
        },
        gaussians: GaussianConfig {
            sh_degree: file.size("sh_degree"),
            router_hidden: head("gate_hidden"),
            projector: head("pixel_projector"),
            neighbors: head("k"),
            predictor: head("predictor_width"),
            parametrization: ParametrizationConfig::Published {
                offset_reach: file.number("gaussian_head.xyz_bias"),
                scale_multiplier: 0.001,
                scale_max: 0.4,
            },
            ..published.gaussians
        },
        raster: published.raster,
    }
}

/// The tensors whose gradients are compared beside the parameters'.
struct Stages<'t, T: Real> {
    total: Var<'t, T>,
    /// The loss with LPIPS, where there are weights for it.
    with_lpips: Result<Var<'t, T>, String>,
    images: Var<'t, T>,
    image_raw: Var<'t, T>,
    render_depth: Var<'t, T>,
    render_alpha: Var<'t, T>,
    means: Var<'t, T>,
    opacities: Var<'t, T>,
}

impl<T: Real> Stages<'_, T> {
    /// Compares the gradient of the images before clamping. Pixels without Gaussians are not compared: there the files
    /// have 0, although the clamp passes the gradient.
    fn check_image_raw(&self, file: &Reference, key: &str) {
        let (alpha, [height, width]) = (self.render_alpha.value(), [2, 3].map(|axis| self.image_raw.shape()[axis]));
        let plane = height * width;
        let drawn = |i: usize| alpha[i / (3 * plane) * plane + i % plane] > T::ZERO;
        file.check_where(key, &self.image_raw.grad().unwrap_or_default(), drawn);
    }
}

pub fn run<T: Real>(file: Reference, weights: Option<&Path>) -> Reference {
    let config = config(&file);
    let mut params = Params::<T>::new();
    let model = SplatWeaver::new(config, &mut params, 0);
    file.load(&mut params);

    let tape = Tape::<T>::new();
    let stages = forward(&file, &model, Context::new(&tape, &params), weights);
    file.backward(stages.total);
    file.check_grad("grad.in.images", stages.images);
    stages.check_image_raw(&file, "grad.stage.image_raw");
    file.check_grad("grad.stage.render_depth", stages.render_depth);
    file.check_grad("grad.stage.means", stages.means);
    file.check_grad("grad.stage.opacities", stages.opacities);
    file.check_params(&params, &tape);

    if let Err(message) = stages.with_lpips {
        for key in file.keys().filter(|key| key.contains("lpips")) {
            file.fail(key, message.clone());
        }
        return file;
    }
    // A second walk back on one tape would add to the gradients of the first.
    let tape = Tape::<T>::new();
    let stages = file.unrecorded(|| forward(&file, &model, Context::new(&tape, &params), weights));
    if let Ok(total) = stages.with_lpips {
        file.backward(total);
        stages.check_image_raw(&file, "grad_lpips.stage.image_raw");
        for (id, param) in params.iter() {
            let gradient = tape.param_grad(id).map(|g| g.to_vec()).unwrap_or_default();
            file.check(&format!("grad_lpips.w.{}", param.name()), &gradient);
        }
    }
    file
}

fn forward<'t, T: Real>(
    file: &Reference,
    model: &SplatWeaver,
    cx: Context<'t, '_, T>,
    weights: Option<&Path>,
) -> Stages<'t, T> {
    let tape = cx.tape;
    let config = model.config();
    let (views, height, width) = (file.size("views"), config.height, config.width);
    let images = file.leaf(tape, "in.images");
    let photos = images.reshape([views, 3, height, width]);
    let encoded = model.encode(cx, images);
    for (tokens, layer) in encoded.tokens.iter().zip(config.dense.layers) {
        file.check(&format!("out.round{layer}"), &tokens.value());
    }
    for (i, code) in encoded.codes.iter().enumerate() {
        file.check(&format!("out.pose{i}"), &code.value());
    }
    check_cameras(file, &encoded.cameras);
    let cameras = encoded.scene_cameras(0);
    let dense = model.dense(cx, &encoded, 0, photos);
    file.check("out.depth_head", &dense.depth.value());
    file.check("out.conf_head", &dense.confidence.value());
    file.check("out.logits", &maps(dense.logits, [views, height, width]).value());

    let allocation = Recorded { noise: file.data("in.gumbel") };
    let predicted = model.gaussians(cx, &dense, photos, &cameras, &allocation, Stream::new(0, 0, "unused"));
    let assigned: Vec<u32> = predicted.assignment.expert.iter().map(|e| u32::from(*e)).collect();
    file.check_indices("out.assigned", &assigned);
    let g = &predicted.gaussians;
    // The stage is the rasterizer's input: a copy, since the gradient of the original includes the neighbor attention.
    let count = g.means.shape()[0];
    let (means, opacities) = (g.means.slice(0, 0, count).retain_grad(), g.opacities.retain_grad());
    let gaussians = [
        ("means", means),
        ("scales", g.scales),
        ("quats", xyzw(g.quats)),
        ("opacities", opacities),
        ("sh", color_major(g.colors)),
    ];
    for (name, y) in gaussians {
        file.check(&format!("out.{name}"), &y.value());
    }
    let neighbors = Neighbors::search(&means.value(), config.gaussians.neighbors, tape.pool());
    file.check_rows("out.knn", neighbors.index(), neighbors.index().len() / predicted.pixel.len().max(1));

    let settings = config.raster.settings();
    let background = tape.constant(&config.raster.background.map(T::from_f64), [3]);
    let drawn = Rasterize::new(width, height, settings, &WorkspacePool::new()).apply(
        &GaussianVars { means, opacities, ..*g },
        &CameraVars { viewmats: cameras.viewmats, intrinsics: cameras.intrinsics.detach() },
        background,
    );
    let image_raw = drawn.image.permute(&[0, 3, 1, 2]).retain_grad();
    let render_depth = drawn.depth.retain_grad();
    let image = image_raw.clamp(0.0, 1.0);
    let safe = file.mask("out.safe");
    let plane = height * width;
    let at = |i: usize| safe[i / (3 * plane) * plane + i % plane];
    file.check_where("out.image_raw", &image_raw.value(), at);
    file.check_where("out.image", &image.value(), at);
    file.check_where("out.render_depth", &render_depth.value(), |i| safe[i]);
    file.check_where("out.render_alpha", &drawn.alpha.value(), |i| safe[i]);

    let target = photos.detach();
    let maps = [views, height, width];
    let teacher: Vec<Var<'t, T>> =
        (0..encoded.codes.len()).map(|i| file.constant(tape, &format!("in.teacher_pose{i}"))).collect();
    let teacher_depth = file.constant(tape, "in.teacher_depth").reshape(maps);
    let confidence = file.constant(tape, "in.teacher_conf").reshape(maps);
    const QUANTILES: [f64; 3] = [0.76, 0.96, 0.98];
    let mut classes = vec![0; dense.energy.shape().len()];
    losses::frequency_targets(&dense.energy.value(), &QUANTILES, &Pool::new(), &mut classes);
    file.check_indices("out.target_class", &classes);
    let choice = predicted.choice.expect("the router chose");
    let terms = [
        ("mse", losses::mse(image, target)),
        ("pose", losses::huber_pose(&encoded.codes, &teacher, 1.0)),
        ("depth", losses::masked_depth_mse(render_depth, teacher_depth, confidence, 0.3)),
        ("rank", losses::ranking_cross_entropy(dense.logits, dense.energy, &QUANTILES, 0.1)),
        ("budget", losses::share_budget(choice, &[0.2, 0.02, 0.02])),
    ];
    let mut total = tape.scalar(T::ZERO);
    for (name, term) in terms {
        file.check(&format!("loss.{name}"), &[term.item()]);
        let weight = if ["rank", "budget"].contains(&name) { "expert" } else { name };
        total = total + term * file.number(&format!("weights.{weight}"));
    }
    file.check("loss.total", &[total.item()]);
    let with_lpips = lpips("vgg", Network::Vgg, weights).map(|lpips| {
        let distance = lpips.distance(target, image).mean();
        file.check("loss.lpips_vgg", &[distance.item()]);
        let sum = total + distance * file.number("weights.lpips_vgg");
        file.check("loss.total_with_lpips", &[sum.item()]);
        sum
    });
    Stages { total, with_lpips, images, image_raw, render_depth, render_alpha: drawn.alpha, means, opacities }
}
