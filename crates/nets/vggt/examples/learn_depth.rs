//! Learns the depth of one scene from photos: `cargo run --release -p weaver-vggt --example learn_depth`.
//!
//! A small vision transformer and a dense head see 18 views of a built-in scene with their depth, and then 6 views from
//! places in between. Writes learn_depth.png (a held-out photo, its true depth, the prediction) and prints the mean
//! relative error.

use weaver_autograd::{Params, Tape, Var};
use weaver_data::{View, procedural};
use weaver_io::{Image, false_color};
use weaver_nn::{AdamW, Builder, Context, Group, WarmupCosine, WeightInit, clip_global_norm};
use weaver_vggt::{
    BackboneInit, DenseTokens, DepthHead, DepthHeadConfig, DptConfig, VisionTransformer, VisionTransformerConfig,
    normalize_image,
};

const WIDTH: usize = 64;
const HEIGHT: usize = 48;
const PATCH: usize = 8;
const DIM: usize = 64;
const STEPS: u64 = 600;

struct Network {
    encoder: VisionTransformer,
    head: DepthHead,
}

impl Network {
    fn new(mut root: Builder<'_>) -> Self {
        let grid = [HEIGHT / PATCH, WIDTH / PATCH];
        let encoder = VisionTransformerConfig {
            patch: PATCH,
            dim: DIM,
            depth: 4,
            heads: 4,
            mlp_ratio: 4,
            registers: 1,
            table: grid,
        };
        let head = DepthHeadConfig {
            dpt: DptConfig { dim: DIM, out_channels: [32, 32, 64, 64], features: 32, width: 16 },
            hidden: 16,
            log_depth_bounds: Some((-4.0, 4.0)),
            last: WeightInit::TruncatedNormal(0.02),
        };
        Self {
            encoder: VisionTransformer::new(root.scope("encoder"), encoder, BackboneInit::FROM_SCRATCH),
            head: DepthHead::new(root.scope("depth_head"), head),
        }
    }

    /// The depth `[1, H, W]` of a photo.
    fn depth<'t>(&self, cx: Context<'t, '_>, view: &View) -> Var<'t> {
        let photo = cx.tape.constant(&view.image.pixels, [1, HEIGHT, WIDTH, 3]).permute(&[0, 3, 1, 2]);
        let tokens = [self.encoder.forward(cx, normalize_image(photo)); 4];
        let grid = [HEIGHT / PATCH, WIDTH / PATCH];
        self.head.forward(cx, DenseTokens { layers: &tokens, special: 0, grid, image: [HEIGHT, WIDTH] }).depth
    }
}

/// The mean of |ln depth - ln truth| over all but the sky: the relative error, when it is small.
fn error<'t>(depth: Var<'t>, truth: &[f32]) -> Var<'t> {
    let known = |truth: &f32| *truth > 0.0;
    let logs: Vec<f32> = truth.iter().map(|z| if known(z) { z.ln() } else { 0.0 }).collect();
    let count = truth.iter().filter(|z| known(z)).count() as f32;
    let weights: Vec<f32> = truth.iter().map(|z| if known(z) { 1.0 / count } else { 0.0 }).collect();
    let (tape, shape) = (depth.tape(), depth.shape());
    ((depth.ln() - tape.constant(&logs, shape)).abs() * tape.constant(&weights, shape)).sum()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let scene = procedural::scene(21, &procedural::ProceduralOptions { width: WIDTH, height: HEIGHT, views: 24 });
    let (training, held_out) = (scene.training_views(), scene.held_out_views());
    let truth = |v: usize| scene.views[v].depth.as_deref().expect("built-in scenes have depth");
    let mut params = Params::<f32>::new();
    let network = Network::new(Builder::new(&mut params, 0));
    let group = Group { params: params.ids().collect(), lr_scale: 2e-3, weight_decay: 0.01 };
    let mut optimizer = AdamW::new(vec![group], 0.9, 0.99, 1e-8);
    let schedule = WarmupCosine { warmup: 20, total: STEPS, floor: 0.01 };

    let mut tape = Tape::new();
    for step in 0..STEPS {
        let batch = (0..3).map(|i| training[(3 * step as usize + i) * 7 % training.len()]);
        let cx = Context::new(&tape, &params);
        let losses = batch.map(|v| error(network.depth(cx, &scene.views[v]), truth(v)));
        let loss = losses.reduce(|a, b| a + b).expect("a batch has views") * (1.0 / 3.0);
        if step % 100 == 0 {
            println!("step {step:3}: {:.1} % off", 100.0 * loss.item());
        }
        loss.backward();
        clip_global_norm(&params, &mut tape, 1.0);
        optimizer.step(&mut params, &mut tape, schedule.factor(step));
        tape.reset();
    }

    let cx = Context::new(&tape, &params);
    let predictions: Vec<Var<'_>> = held_out.iter().map(|v| network.depth(cx, &scene.views[*v])).collect();
    let off: Vec<f32> = held_out.iter().zip(&predictions).map(|(v, depth)| error(*depth, truth(*v)).item()).collect();
    println!("held-out views: {:.1} % off", 100.0 * off.iter().sum::<f32>() / off.len() as f32);
    let seen = truth(held_out[0]);
    let logs =
        |z: &[f32]| z.iter().zip(seen).map(|(z, t)| if *t > 0.0 { -z.ln() } else { f32::NAN }).collect::<Vec<_>>();
    let (low, high) =
        logs(seen).iter().filter(|x| !x.is_nan()).fold((f32::MAX, f32::MIN), |(a, b), x| (a.min(*x), b.max(*x)));
    // Near is bright, sky is black.
    let colors = |depth: &[f32]| false_color(&logs(depth), WIDTH, HEIGHT, low, high);
    let pictures = [&scene.views[held_out[0]].image, &colors(seen), &colors(&predictions[0].value())];
    Image::mosaic(&pictures).write_png("learn_depth.png")?;
    Ok(())
}
