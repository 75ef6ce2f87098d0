//! `splatweaver image bench`.

use crate::arguments::ImageBench;
use crate::others::{Codec, OWN, codecs};
use crate::read::{failure, read};
use crate::report;
use crate::results::{Judged, Method};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;
use weaver_command::{Console, Failure};
use weaver_image::{Canvas, Gaussians, ImageError, Picture, Tiled, Window, decode, decode_region, fit};
use weaver_io::{Image, OutputFolder};
use weaver_kernels::peak;
use weaver_run::{Folder, Page};

/// Sides of the region whose drawing is timed.
const REGION: usize = 64;
/// Repetitions of what is timed, of which the fastest counts.
const RUNS: usize = 5;
/// Floating-point operations of a step for each block of 16 pixels that a Gaussian meets: 25 products and sums of vectors, fused or not.
const BLOCK_OPERATIONS: f64 = 25.0 * 16.0 * 2.0;

/// A fit at one ratio.
pub struct Measured {
    pub ratio: f64,
    pub judged: Judged,
    /// Milliseconds of the fit for each step, of a step of the last Gaussians, and what the processor could do such a step in.
    steps: [f64; 3],
    /// Milliseconds of decoding and drawing a megapixel.
    decoding: f64,
    /// Microseconds of decoding and drawing a region.
    region: f64,
}

pub fn run(arguments: &ImageBench, console: &mut Console) -> Result<(), Failure> {
    let threads = rayon::current_num_threads();
    if let Some(ratio) = arguments.ratios.iter().find(|ratio| !(**ratio > 0.0 && ratio.is_finite())) {
        return Err(Failure::Usage(format!("--ratios: expected numbers above 0, found {ratio}")));
    }
    let out = arguments.out.as_deref().map(|out| OutputFolder::claim(out, "image bench", &arguments.pictures));
    let out = out.transpose()?;
    let gflops = peak::fma_gflops_f32(threads);
    let source = if arguments.others.is_some() { "codecs from the files given" } else { OWN };
    console.print(&format!("{threads} threads, {gflops:.0} GFLOP/s at most; beside: {source}, at equal bytes"))?;
    let mut page = Page::new("Pictures as Gaussians and by other codecs");
    page.heading(1, "Pictures as Gaussians and by other codecs");
    page.paragraph("Columns of other codecs: PSNR and MS-SSIM at the same bytes, between their two nearest files.");
    for path in &arguments.pictures {
        let picture = read(path, console)?;
        let (width, height) = (picture.width(), picture.height());
        console.print(&format!("{}: {width} x {height}", path.display()))?;
        let codecs = codecs(path, &picture, arguments.others.as_deref())?;
        let names: String = codecs.iter().map(|codec| format!("  {:>12}", codec.name)).collect();
        console.print(&format!(
            "ratio  Gaussians   bytes  bits/px     dB  MS-SSIM{names}  ms/step  last step  floor  decode ms/Mpx  region us"
        ))?;
        let mut measured = Vec::new();
        for ratio in arguments.ratios.iter().copied() {
            let (steps, seed) = (arguments.steps as usize, arguments.seed);
            let method = Method { ratio: Some(ratio), gaussians: None, steps, seed, published: false };
            let at = measure(&picture, path, &method, gflops).map_err(|error| failure(path, &error))?;
            console.print(&line(&at, &codecs))?;
            measured.push(at);
        }
        if out.is_some() {
            let photo = Image { width, height, pixels: picture.colors().to_vec() };
            let name = path.file_stem().unwrap_or_default().to_string_lossy();
            report::add(&mut page, &name, &photo, &measured, &codecs)?;
        }
    }
    match out {
        Some(out) => {
            let file = out.file(Folder::REPORT)?;
            page.write(&file)?;
            console.print(&file.display().to_string())
        }
        None => Ok(()),
    }
}

fn line(at: &Measured, codecs: &[Codec]) -> String {
    let row = &at.judged.row;
    let beside: String = codecs.iter().map(|codec| format!("  {:>12}", report::beside(codec, row.bytes))).collect();
    let [each, last, floor] = at.steps;
    format!(
        "{:>5}  {:>9}  {:>6}  {:>7.3}  {:>5.2}  {:>7}{beside}  {each:>7.2}  {last:>9.2}  {floor:>5.2}  {:>13.1}  {:>9.0}",
        at.ratio,
        row.gaussians,
        row.bytes,
        row.bits_per_pixel(),
        row.psnr,
        row.ms_ssim.map_or("-".into(), |x| format!("{x:.3}")),
        at.decoding,
        at.region
    )
}

/// The fastest of several runs, seconds.
fn fastest(mut body: impl FnMut() -> Result<(), ImageError>) -> Result<f64, ImageError> {
    let mut least = f64::INFINITY;
    for _ in 0..RUNS {
        let begin = Instant::now();
        body()?;
        least = least.min(begin.elapsed().as_secs_f64());
    }
    Ok(least)
}

fn measure(picture: &Picture, path: &Path, method: &Method, gflops: f64) -> Result<Measured, ImageError> {
    let (width, height) = (picture.width(), picture.height());
    let begin = Instant::now();
    let settings = method.settings(method.count(picture));
    let fitted = fit(picture, &settings, &mut |_| ControlFlow::Continue(()))?;
    let each = begin.elapsed().as_secs_f64() * 1e3 / method.steps as f64;
    let judged = Judged::new(path, picture, &fitted)?;
    let target = Tiled::new(picture.colors(), width, height)?;
    let (mut canvas, mut gradient) = (Canvas::new(), Gaussians::default());
    let last = fastest(|| {
        canvas.place(&fitted.gaussians, Window::whole(width, height), fitted.cut)?;
        canvas.squared_error(&fitted.gaussians, &target, &mut gradient).map(drop)
    })?;
    let floor = canvas.blocks() as f64 * BLOCK_OPERATIONS / (gflops * 1e6);
    let bytes = &judged.bytes;
    let whole = fastest(|| decode(bytes)?.fitted.draw(width, height).map(drop))?;
    let side = |length: usize| REGION.min(length);
    let window = Window {
        x: (width - side(width)) / 2,
        y: (height - side(height)) / 2,
        width: side(width),
        height: side(height),
    };
    let part = fastest(|| {
        let mut read = |range: std::ops::Range<u64>| Ok(bytes[range.start as usize..range.end as usize].to_vec());
        decode_region(bytes.len() as u64, &mut read, window)?.fitted.draw_window(window).map(drop)
    })?;
    Ok(Measured {
        ratio: method.ratio.unwrap_or(0.0),
        steps: [each, last * 1e3, floor],
        decoding: whole * 1e9 / picture.pixels() as f64,
        region: part * 1e6,
        judged,
    })
}
