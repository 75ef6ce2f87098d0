//! Turns one photo with known depth into Gaussians: `cargo run --release -p weaver-experts --example learn_view`.
//!
//! One pixel in four gets a Gaussian. In the footprint parametrization even an untrained head places them upright, in
//! the color and the size of their pixels; a few hundred steps teach it to draw the photo better. Writes learn_view.png
//! (the photo, the render before training, the render after it) and prints how close the renders are.

use weaver_autograd::{Params, Tape, Var};
use weaver_data::procedural::{ProceduralOptions, scene};
use weaver_experts::{CardinalityHead, HeadConfig, PixelInputs};
use weaver_io::Image;
use weaver_kernels::random::Stream;
use weaver_nn::{AdamW, Builder, Context, Group, WarmupCosine};
use weaver_pose::CameraVars;
use weaver_router::{Allocation, AllocationRequest, Assignment, Grid};
use weaver_splat::{RasterSettings, Rasterize, WorkspacePool};

const WIDTH: usize = 96;
const HEIGHT: usize = 72;
const PIXELS: usize = WIDTH * HEIGHT;
/// Color, position in the image, and depth.
const FEATURES: usize = 6;
const STEPS: u64 = 300;

/// A photo: features, depth, color, and the camera, whose frame is the world's.
struct Photo {
    colors: Vec<f32>,
    features: Vec<f32>,
    depth: Vec<f32>,
    intrinsics: [f32; 4],
}

impl Photo {
    fn new() -> Self {
        let view = scene(12, &ProceduralOptions { width: WIDTH, height: HEIGHT, views: 4 }).views.swap_remove(0);
        let known = view.depth.expect("built-in scenes have depth");
        let farthest = known.iter().copied().fold(0.0, f32::max);
        // The sky has no depth: it is put behind all else.
        let depth: Vec<f32> = known.iter().map(|z| if *z > 0.0 { *z } else { 1.5 * farthest }).collect();
        let colors = view.image.pixels;
        let row = |i: usize| {
            let [x, y] = [(i % WIDTH) as f32 / WIDTH as f32, (i / WIDTH) as f32 / HEIGHT as f32];
            [colors[3 * i], colors[3 * i + 1], colors[3 * i + 2], x, y, depth[i].ln()]
        };
        let k = view.camera.intrinsics;
        let features = (0..PIXELS).flat_map(row).collect();
        Self { features, depth, colors, intrinsics: [k.fx, k.fy, k.cx, k.cy].map(|v| v as f32) }
    }

    /// The render `[1, H, W, 3]` of the photo's Gaussians.
    fn render<'t>(
        &self,
        cx: Context<'t, '_>,
        head: &CardinalityHead,
        assignment: &Assignment,
        workspaces: &WorkspacePool<f32>,
    ) -> Var<'t> {
        let tape = cx.tape;
        let intrinsics = tape.constant(&self.intrinsics, [1, 4]);
        let viewmats = tape.constant(&[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0], [1, 3, 4]);
        let depth = tape.constant(&self.depth, [1, HEIGHT, WIDTH]);
        let pixels = PixelInputs {
            features: tape.constant(&self.features, [PIXELS, FEATURES]),
            points: weaver_pose::unproject(depth, viewmats, intrinsics, 0.5).reshape([PIXELS, 3]),
            footprints: Some((depth * f64::from(1.0 / self.intrinsics[0])).reshape([PIXELS])),
            colors: Some(tape.constant(&self.colors, [PIXELS, 3])),
            height: HEIGHT,
            width: WIDTH,
        };
        let gaussians = head.gaussians(cx, &pixels, assignment, None).gaussians;
        let background = tape.constant(&[0.0; 3], [3]);
        let rasterize = Rasterize::new(WIDTH, HEIGHT, RasterSettings::default(), workspaces);
        rasterize.apply(&gaussians, &CameraVars { viewmats, intrinsics }, background).image
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let photo = Photo::new();
    let mut params = Params::<f32>::new();
    let config = HeadConfig { features: FEATURES, ..HeadConfig::tiny() };
    let head = CardinalityHead::new(Builder::new(&mut params, 0).scope("gs_moe"), config);
    let group = Group { params: params.ids().collect(), lr_scale: 3e-3, weight_decay: 0.0 };
    let mut optimizer = AdamW::new(vec![group], 0.9, 0.99, 1e-8);
    let schedule = WarmupCosine { warmup: 20, total: STEPS, floor: 0.01 };
    let workspaces = WorkspacePool::new();

    let mut tape = Tape::new();
    let assignment = Grid { budget: 0.25 }.allocate(&AllocationRequest {
        logits: &[0.0; 2 * PIXELS],
        energy: &[0.0; PIXELS],
        photos: &[],
        depth: None,
        views: 1,
        height: HEIGHT,
        width: WIDTH,
        stream: Stream::new(0, 0, "learn_view"),
        inside: None,
        gumbel: None,
        pool: tape.pool(),
    });
    println!("{} Gaussians for {PIXELS} pixels", assignment.count());
    let mut pictures = vec![photo.colors.clone()];
    for step in 0..=STEPS {
        let image = photo.render(Context::new(&tape, &params), &head, &assignment, &workspaces);
        let loss = (image - tape.constant(&photo.colors, image.shape())).square().mean();
        if step % 100 == 0 {
            println!("step {step:3}: {:.1} dB", -10.0 * loss.item().log10());
        }
        if step == 0 || step == STEPS {
            pictures.push(image.to_vec());
        }
        loss.backward();
        optimizer.step(&mut params, &mut tape, schedule.factor(step));
        tape.reset();
    }
    let images: Vec<Image> =
        pictures.into_iter().map(|pixels| Image { width: WIDTH, height: HEIGHT, pixels }).collect();
    Image::mosaic(&images.iter().collect::<Vec<_>>()).write_png("learn_view.png")?;
    Ok(())
}
