//! Learns the views of one built-in scene: `cargo run --release -p weaver-two-experts --example overfit [STEPS]`.
//!
//! Four photos go in; the loss on a fifth, held out of the input, measures generalization.

use weaver_autograd::{Params, Tape};
use weaver_nn::{AdamW, Builder, Context, Group, clip_factor, global_norm};
use weaver_pose::CameraVars;
use weaver_procedural::{ProceduralOptions, scene};
use weaver_scene::{intrinsics_row, viewmat};
use weaver_splat::{RasterSettings, Rasterize, WorkspacePool};
use weaver_two_experts::{OpacityDegree, Parametrization, Pyramid, PyramidConfig};

const SIZE: [usize; 2] = [48, 64];

fn main() {
    let steps = std::env::args().nth(1).and_then(|n| n.parse().ok()).unwrap_or(300);
    let [height, width] = SIZE;
    let scene = scene(1000, &ProceduralOptions { width, height, views: 5 });
    let first = scene.views[0].camera.pose;
    let scale = 0.25;
    let viewmats: Vec<f32> =
        scene.views.iter().flat_map(|view| viewmat(&view.camera.pose.relative_to(&first).scaled(scale))).collect();
    let intrinsics: Vec<f32> = scene.views.iter().flat_map(|view| intrinsics_row(&view.camera)).collect();
    let planes = |v: usize| {
        let pixels = &scene.views[v].image.pixels;
        (0..3).flat_map(|c| pixels.iter().skip(c).step_by(3).copied()).collect::<Vec<f32>>()
    };
    let photos: Vec<f32> = (0..5).flat_map(planes).collect();

    let config = PyramidConfig {
        patch: 4,
        width: 32,
        blocks: [1, 2, 2],
        head: 16,
        mlp_ratio: 4,
        registers: 2,
        group: 2,
        features: 48,
        cameras: true,
        world_rays: true,
        opacity: OpacityDegree::Constant,
        gain: 0.3,
    };
    let mut params = Params::<f32>::new();
    let network = Pyramid::new(Builder::new(&mut params, 0), config);
    let mut optimizer =
        AdamW::new(vec![Group { params: params.ids().collect(), lr_scale: 1.0, weight_decay: 0.0 }], 0.9, 0.99, 1e-8);
    let (mut tape, workspaces) = (Tape::new(), WorkspacePool::new());
    for step in 0..=steps {
        tape.reset();
        let of = |first: usize, count: usize| CameraVars {
            viewmats: tape.constant(&viewmats[12 * first..12 * (first + count)], [count, 3, 4]),
            intrinsics: tape.constant(&intrinsics[4 * first..4 * (first + count)], [count, 4]),
        };
        let all = tape.constant(&photos, [5, 3, height, width]);
        let (seen, cameras) = (all.slice(0, 0, 4), of(0, 4));
        let (raw, _) = network.forward(Context::new(&tape, &params), seen, &cameras);
        let (gaussians, _) = raw.gaussians(Parametrization::Footprint { scale: 0.7 }, cameras.intrinsics, seen);
        let white = tape.constant(&[1.0; 3], [3]);
        let op = Rasterize::new(width, height, RasterSettings::default(), &workspaces).without_depth();
        let image = op.apply(&gaussians, &of(0, 5), white).image.permute(&[0, 3, 1, 2]);
        let error = |first: usize, count: usize| (image - all).slice(0, first, count).square().mean();
        let (loss, unseen) = (error(0, 4), error(4, 1).item());
        if step % 50 == 0 {
            let psnr = |x: f32| -10.0 * x.log10();
            println!("step {step}: {:.2} dB seen, {:.2} dB unseen", psnr(loss.item()), psnr(unseen));
        }
        loss.backward();
        let clip = clip_factor(global_norm(&params, &tape), 1.0);
        optimizer.step_scaled(&mut params, &mut tape, 1e-3, clip);
    }
}
