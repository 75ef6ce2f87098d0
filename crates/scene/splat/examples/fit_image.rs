//! Fits a picture with Gaussians: `cargo run --release -p weaver-splat --example fit_image [PICTURE [SEED]]`.
//!
//! The Gaussians stand near a plane in front of one camera. Adam moves, turns, stretches and colors them until their
//! render is the picture. Writes fit_image.png (the picture, the start, the fit) and prints the peak signal-to-noise
//! ratio.

use weaver_autograd::{Params, Tape};
use weaver_data::procedural::{ProceduralOptions, scene};
use weaver_io::{Background, Image};
use weaver_kernels::random::Stream;
use weaver_nn::{AdamW, Context, Group, WarmupCosine};
use weaver_pose::CameraVars;
use weaver_splat::{GaussianVars, RasterSettings, Rasterize, WorkspacePool};

const GAUSSIANS: usize = 2000;
const STEPS: u64 = 400;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let seed = std::env::args().nth(2).map_or(Ok(0), |seed| seed.parse())?;
    let photo = match std::env::args().nth(1) {
        Some(path) => Image::read(path, Background::White)?,
        None => scene(4, &ProceduralOptions { width: 160, height: 120, views: 4 }).views[1].image.clone(),
    };
    let (w, h) = (photo.width, photo.height);
    let (n, pixel) = (GAUSSIANS, 1.0 / w as f32); // the picture is one unit wide

    // Gaussians of the size that covers the picture, at random places, colored like the picture there.
    let stream = Stream::new(seed, 0, "fit_image");
    let places: Vec<usize> = (0..n as u64).map(|i| stream.below(i, w * h)).collect();
    let size = 0.6 * (h as f32 * pixel / n as f32).sqrt();
    let place = |(i, p): (usize, &usize)| {
        let [x, y] = [p % w, p / w].map(|at| at as f32 + 0.5);
        [(x - 0.5 * w as f32) * pixel, (y - 0.5 * h as f32) * pixel, 1.0 + 0.1 * (i as f32 / n as f32)]
    };
    let mut params = Params::<f32>::new();
    let means = params.add("means", [n, 3], places.iter().enumerate().flat_map(place).collect());
    let quats = params.add("quats", [n, 4], [1.0, 0.0, 0.0, 0.0].repeat(n));
    let log_scales = params.add("log_scales", [n, 3], vec![size.ln(); 3 * n]);
    let logits = params.add("opacity_logits", [n], vec![0.0; n]);
    let color = |p: &usize| [0, 1, 2].map(|c| photo.pixels[3 * p + c]);
    let colors = params.add("colors", [n, 3], places.iter().flat_map(color).collect());

    let rates = [(means, 0.3 * pixel), (quats, 0.01), (log_scales, 0.02), (logits, 0.03), (colors, 0.01)];
    let group = |(id, rate)| Group { params: vec![id], lr_scale: f64::from(rate), weight_decay: 0.0 };
    let mut optimizer = AdamW::new(rates.map(group).to_vec(), 0.9, 0.99, 1e-15);
    let schedule = WarmupCosine { warmup: 1, total: STEPS, floor: 0.05 };
    let (mut tape, workspaces) = (Tape::<f32>::new(), WorkspacePool::new());
    let mut pictures = vec![photo.clone()];
    for step in 0..=STEPS {
        let cx = Context::new(&tape, &params);
        let gaussians = GaussianVars {
            means: cx.param(means),
            quats: cx.param(quats),
            scales: cx.param(log_scales).exp(),
            opacities: cx.param(logits).sigmoid(),
            colors: cx.param(colors),
        };
        let (focal, cx, cy) = (w as f32, 0.5 * w as f32, 0.5 * h as f32);
        let camera = CameraVars {
            viewmats: tape.constant(&[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0], [1, 3, 4]),
            intrinsics: tape.constant(&[focal, focal, cx, cy], [1, 4]),
        };
        let background = tape.constant(&[0.0; 3], [3]);
        let rasterize = Rasterize::new(w, h, RasterSettings::default(), &workspaces);
        let image = rasterize.apply(&gaussians, &camera, background).image;
        let loss = (image - tape.constant(&photo.pixels, image.shape())).square().mean();
        if step % 100 == 0 {
            println!("step {step:3}: {:.2} dB", -10.0 * loss.item().log10());
        }
        if step == 0 || step == STEPS {
            pictures.push(Image { width: w, height: h, pixels: image.to_vec() });
        }
        loss.backward();
        optimizer.step(&mut params, &mut tape, schedule.factor(step));
        tape.reset();
    }
    Image::mosaic(&pictures.iter().collect::<Vec<_>>()).write_png("fit_image.png")?;
    Ok(())
}
