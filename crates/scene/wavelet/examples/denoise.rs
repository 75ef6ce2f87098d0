//! Learns to take noise out of pictures: `cargo run --release -p weaver-wavelet --example denoise`.
//!
//! A small network sees the Haar sub-bands of a noisy picture, three levels deep, and says how much of every
//! coefficient is noise. Trained on built-in scenes, tried on one that it has not seen. Writes denoise.png (clean,
//! noisy, denoised) and prints the peak signal-to-noise ratios.

use weaver_autograd::{Params, Tape, Var, ops};
use weaver_data::procedural::{ProceduralOptions, scene};
use weaver_io::Image;
use weaver_kernels::random::Stream;
use weaver_nn::{AdamW, Builder, Context, Conv2d, Group, WarmupCosine, WeightInit};
use weaver_wavelet::{Wavelet, analysis, synthesis};

const SIGMA: f32 = 0.1;
const STEPS: u64 = 800;
const SIZE: [usize; 2] = [96, 128];

/// One level: three convolutions over the twelve sub-bands, and another level for the low ones.
struct Level {
    convs: [Conv2d; 3],
    coarser: Option<Box<Level>>,
}

impl Level {
    fn new(mut builder: Builder<'_>, levels: usize) -> Self {
        let coarser = (levels > 1).then(|| Box::new(Self::new(builder.scope("coarser"), levels - 1)));
        let mut conv = |name, from, to, init| Conv2d::new(builder.scope(name), from, to, 3, init);
        let (fan_in, zero) = (WeightInit::FanIn, WeightInit::Zero);
        let convs = [conv("first", 12, 48, fan_in), conv("second", 48, 48, fan_in), conv("last", 48, 12, zero)];
        Self { convs, coarser }
    }

    /// The noise in the channels `[3, H, W]` of a picture, of the same shape.
    fn noise<'t>(&self, cx: Context<'t, '_>, x: Var<'t>) -> Var<'t> {
        let bands = analysis(x, Wavelet::Haar);
        let (h, w) = (bands.shape()[2], bands.shape()[3]);
        let hidden = self.convs[0].forward(cx, bands.reshape([1, 12, h, w])).gelu();
        let hidden = self.convs[1].forward(cx, hidden).gelu();
        let mut noise = self.convs[2].forward(cx, hidden).reshape([3, 4, h, w]);
        if let Some(coarser) = &self.coarser {
            // The low band is twice the mean of four pixels: half of it is a picture again.
            let low = coarser.noise(cx, bands.slice(1, 0, 1).reshape([3, h, w]) * 0.5) * 2.0;
            let low = noise.slice(1, 0, 1) + low.reshape([3, 1, h, w]);
            noise = ops::concat(&[low, noise.slice(1, 1, 3)], 1);
        }
        synthesis(noise, Wavelet::Haar, [x.shape()[1], x.shape()[2]])
    }
}

/// The three channels `[3, H, W]` of a scene's first photo.
fn channels(seed: u64) -> Vec<f32> {
    let options = ProceduralOptions { width: SIZE[1], height: SIZE[0], views: 4 };
    let pixels = &scene(seed, &options).views[0].image.pixels;
    (0..3).flat_map(|c| pixels.iter().skip(c).step_by(3).copied()).collect()
}

fn image(channels: &[f32]) -> Image {
    let [height, width] = SIZE;
    let pixels = (0..height * width).flat_map(|i| [0, 1, 2].map(|c| channels[c * height * width + i])).collect();
    Image { width, height, pixels }
}

fn noisy(clean: &[f32], step: u64) -> Vec<f32> {
    let stream = Stream::new(0, step, "denoise");
    clean.iter().zip(0..).map(|(x, i)| x + SIGMA * stream.normal::<f32>(i)).collect()
}

fn psnr(a: &[f32], b: &[f32]) -> f64 {
    let squares: f64 = a.iter().zip(b).map(|(a, b)| f64::from((a - b) * (a - b))).sum();
    -10.0 * (squares / a.len() as f64).log10()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut params = Params::<f32>::new();
    let network = Level::new(Builder::new(&mut params, 0).scope("denoiser"), 3);
    let group = Group { params: params.ids().collect(), lr_scale: 2e-3, weight_decay: 0.0 };
    let mut optimizer = AdamW::new(vec![group], 0.9, 0.99, 1e-8);
    let schedule = WarmupCosine { warmup: 10, total: STEPS, floor: 0.01 };
    let photos: Vec<Vec<f32>> = (0..24).map(channels).collect();

    let shape = [3, SIZE[0], SIZE[1]];
    let mut tape = Tape::new();
    for step in 0..STEPS {
        let clean = &photos[step as usize % photos.len()];
        let x = tape.constant(&noisy(clean, step + 1), shape);
        let loss = (x - network.noise(Context::new(&tape, &params), x) - tape.constant(clean, shape)).square().mean();
        if step % 200 == 0 {
            println!("step {step:3}: {:.2} dB", -10.0 * loss.item().log10());
        }
        loss.backward();
        optimizer.step(&mut params, &mut tape, schedule.factor(step));
        tape.reset();
    }

    let clean = channels(100);
    let dirty = noisy(&clean, 0);
    let x = tape.constant(&dirty, shape);
    let result = (x - network.noise(Context::new(&tape, &params), x)).to_vec();
    println!("an unseen picture: {:.2} dB noisy, {:.2} dB denoised", psnr(&dirty, &clean), psnr(&result, &clean));
    Image::mosaic(&[&image(&clean), &image(&dirty), &image(&result)]).write_png("denoise.png")?;
    Ok(())
}
