//! Quality of fitted pictures: `RAYON_NUM_THREADS=1 weaver-studies pictures TABLE PHOTO..`.
//!
//! Tables, each over the middle 512 x 512 pixels of the photos and three seeds: `fits` (ours, published and controls),
//! `starts` (the worth of each part of a start, by the published descent), `files` (decibels and bytes of files),
//! `variants` (the worth of each part of ours), `colors` (closed-form colors alone), `planted` (recovery of planted
//! Gaussians; needs no photo). Seconds are processor time.

use crate::Outcome;
use crate::arguments::Arguments;
use crate::table::{Table, mean};
use std::ops::ControlFlow;
use weaver_image::{
    CUT, Canvas, FitSettings, Gaussians, Picture, Start, Window, decode, encode, fit, metrics, refine, solve_colors,
    start,
};
use weaver_io::{Background, Bitmap, Image};
use weaver_kernels::random::Stream;

const SIDE: usize = 512;
const SEEDS: u64 = 3;
const TABLES: &str = "fits, starts, files, variants, colors or planted";

/// Fits of all photos, a row for each kind.
struct Fits<'a> {
    pictures: &'a [Picture],
    table: Table,
}

impl<'a> Fits<'a> {
    fn new(title: &str, pictures: &'a [Picture]) -> Self {
        let columns = ["dB", "each", "seeds within", "MS-SSIM", "s"];
        Self { pictures, table: Table::new(title, &columns) }
    }

    /// Decibels, similarity and processor seconds of fits with settings for a number of Gaussians.
    fn row(&self, name: &str, settings: &dyn Fn(usize) -> FitSettings) -> Outcome {
        let mut means = Vec::new();
        let (mut spread, mut seconds, mut similar) = (0.0_f64, 0.0, 0.0);
        for picture in self.pictures {
            let mut found = Vec::new();
            for seed in 0..SEEDS {
                let mut settings = settings(picture.gaussians_for(50.0));
                settings.seed = seed;
                let before = processor_seconds()?;
                let fitted = fit(picture, &settings, &mut |_| ControlFlow::Continue(()))?;
                seconds += processor_seconds()? - before;
                let drawn = fitted.draw(picture.width(), picture.height())?;
                found.push(metrics::psnr(&drawn, picture.colors()));
                similar +=
                    metrics::ms_ssim(&drawn, picture.colors(), [picture.height(), picture.width()]).unwrap_or(0.0);
            }
            spread = spread.max(range(&found));
            means.push(mean(&found));
        }
        let runs = (self.pictures.len() as u64 * SEEDS) as f64;
        let each: Vec<String> = means.iter().map(|x| format!("{x:.2}")).collect();
        let cells = [
            format!("{:.2}", mean(&means)),
            each.join(" "),
            format!("{spread:.2}"),
            format!("{:.3}", similar / runs),
            format!("{:.2}", seconds / runs),
        ];
        self.table.row(name, &cells);
        Ok(())
    }
}

/// Difference of the largest and the smallest.
fn range(x: &[f64]) -> f64 {
    let [low, high] = [f64::min, f64::max].map(|pick| x.iter().copied().reduce(pick).unwrap_or(0.0));
    high - low
}

/// User and system time of this process.
fn processor_seconds() -> Outcome<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat")?;
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or("").split_whitespace().collect();
    let ticks = |i: usize| fields.get(i).ok_or("a line of /proc/self/stat").map(|x| x.parse::<f64>());
    Ok((ticks(11)?? + ticks(12)??) / 100.0)
}

fn fits(pictures: &[Picture]) -> Outcome {
    let rows = Fits::new("Fits", pictures);
    for steps in [300, 1000, 3000] {
        rows.row(&format!("ours, {steps} steps"), &|n| FitSettings::new(n, steps))?;
    }
    rows.row("control: random start at our rates, 300", &|n| {
        let mut settings = FitSettings::new(n, 300);
        (settings.start, settings.color_steps, settings.growth) = (Start::Random, 0, false);
        settings
    })?;
    for steps in [300, 1000, 3000] {
        rows.row(&format!("published, {steps} steps"), &|n| FitSettings::published(n, steps))?;
    }
    Ok(())
}

fn starts(pictures: &[Picture]) -> Outcome {
    let rows = Fits::new("Starts", pictures);
    let kinds = [
        ("random", Start::Random, 0),
        ("and published positions", Start::Positions, 0),
        ("and published scales", Start::Scales, 0),
        ("and published colors", Start::Published, 0),
        ("published, closed colors", Start::Published, 10),
        ("quadtree, mean colors", Start::Quadtree, 0),
        ("quadtree, closed colors", Start::Quadtree, 10),
    ];
    for (name, kind, color_steps) in kinds {
        rows.row(&format!("{name}, 300 published steps"), &|n| {
            let mut settings = FitSettings::published(n, 300);
            (settings.start, settings.color_steps) = (kind, color_steps);
            settings
        })?;
    }
    Ok(())
}

fn variants(pictures: &[Picture]) -> Outcome {
    let rows = Fits::new("Variants", pictures);
    let kinds = [
        ("squared error, our rates, published start", Start::Published, 0, false, false),
        ("and closed colors", Start::Published, 10, false, false),
        ("and quadtree", Start::Quadtree, 10, false, false),
        ("and coarse to fine", Start::Quadtree, 10, false, true),
        ("and growth", Start::Quadtree, 10, true, false),
        ("and both", Start::Quadtree, 10, true, true),
    ];
    for (name, kind, color_steps, growth, coarse) in kinds {
        for steps in [300, 1000] {
            rows.row(&format!("{name}, {steps}"), &|n| {
                let mut settings = FitSettings::new(n, steps);
                settings.start = kind;
                settings.color_steps = color_steps;
                settings.growth = growth;
                settings.coarse = coarse;
                settings
            })?;
        }
    }
    Ok(())
}

/// Decibels of the best baseline JPEG, by weaver-io's encoder, of at most `most` bytes.
fn jpeg(picture: &Picture, most: usize) -> Outcome<String> {
    let image = Image { width: picture.width(), height: picture.height(), pixels: picture.colors().to_vec() };
    let bitmap = Bitmap { width: image.width, height: image.height, pixels: image.to_bytes() };
    let mut best = None;
    for quality in 1..=95 {
        let bytes = bitmap.to_jpeg(quality)?;
        if bytes.len() > most {
            break;
        }
        best = Some(bytes);
    }
    let Some(bytes) = best else { return Ok(" (JPEG -)".into()) };
    let back = Image::decode(&bytes, "a JPEG in memory", Background::Black)?;
    Ok(format!(" (JPEG {:.2})", metrics::psnr(&back.pixels, picture.colors())))
}

fn files(pictures: &[Picture]) -> Outcome {
    let table = Table::new("Files", &["each", "seeds within", "mean dB", "s"]);
    for ratio in [200.0, 100.0, 50.0, 25.0] {
        for steps in [300, 1000] {
            for (name, coded, straight_through) in
                [("staged", true, false), ("plain", false, false), ("straight through", true, true)]
            {
                let mut each = Vec::new();
                let (mut sum, mut spread, before) = (0.0, 0.0_f64, processor_seconds()?);
                for picture in pictures {
                    let mut settings = FitSettings::new(picture.gaussians_for(ratio), steps);
                    (settings.coded, settings.straight_through) = (coded, straight_through);
                    let (mut bytes, mut found) = (0, Vec::new());
                    for seed in 0..SEEDS {
                        settings.seed = seed;
                        let fitted = fit(picture, &settings, &mut |_| ControlFlow::Continue(()))?;
                        let file = encode(&fitted, picture.width(), picture.height())?;
                        let drawn = decode(&file)?.fitted.draw(picture.width(), picture.height())?;
                        found.push(metrics::psnr(&drawn, picture.colors()));
                        bytes += file.len();
                    }
                    let (bytes, decibels) = (bytes / SEEDS as usize, mean(&found));
                    (sum, spread) = (sum + decibels, spread.max(range(&found)));
                    let jpeg = if coded && !straight_through { jpeg(picture, bytes)? } else { String::new() };
                    each.push(format!("{bytes} B {decibels:.2} dB{jpeg}"));
                }
                let runs = pictures.len() as f64 * SEEDS as f64;
                let seconds = (processor_seconds()? - before) / runs;
                let mean = sum / pictures.len() as f64;
                let cells = [each.join(", "), format!("{spread:.2}"), format!("{mean:.2}"), format!("{seconds:.2}")];
                table.row(&format!("ratio {ratio}, {steps} steps, {name}"), &cells);
            }
        }
    }
    Ok(())
}

fn decibels(gaussians: &Gaussians<f32>, picture: &Picture) -> Outcome<f64> {
    let mut canvas = Canvas::new();
    canvas.place(gaussians, Window::whole(picture.width(), picture.height()), CUT)?;
    let mut image = vec![0.0; picture.colors().len()];
    canvas.draw(&gaussians.colors, &mut image)?;
    Ok(metrics::psnr(&image, picture.colors()))
}

fn colors(pictures: &[Picture]) -> Outcome {
    let table = Table::new("Colors", &["before, dB", "closed colors, dB"]);
    for picture in pictures {
        let count = picture.gaussians_for(50.0);
        for kind in [Start::Published, Start::Quadtree] {
            let mut gaussians = start(picture, count, kind, 0);
            let before = decibels(&gaussians, picture)?;
            solve_colors(picture, &mut gaussians, CUT, 10)?;
            let after = decibels(&gaussians, picture)?;
            table.row(&format!("{kind:?}"), &[before, after].map(|x| format!("{x:.2}")));
        }
    }
    Ok(())
}

fn planted() -> Outcome {
    const SIDE: usize = 256;
    let table = Table::new("Planted, dB", &["N = 50", "N = 100", "from near the truth"]);
    for seed in 0..SEEDS {
        let stream = Stream::new(seed, 0, "image.planted");
        let mut truth = Gaussians::default();
        for i in 0..50 {
            let u = |k: u64| stream.uniform::<f32>(8 * i + k);
            let scale = [0, 1].map(|k| 4.0 + 14.0 * u(k));
            truth.push([2, 3].map(|k| SIDE as f32 * u(k)), scale, 3.0 * u(4), [5, 6, 7].map(|k| 0.1 + 0.3 * u(k)));
        }
        let mut canvas = Canvas::new();
        canvas.place(&truth, Window::whole(SIDE, SIDE), CUT)?;
        let mut image = vec![0.0; 3 * SIDE * SIDE];
        canvas.draw(&truth.colors, &mut image)?;
        let largest = image.iter().fold(1.0_f32, |most, x| most.max(*x));
        image.iter_mut().for_each(|x| *x = (*x / largest).max(0.0));
        truth.colors.iter_mut().for_each(|c| *c /= largest);
        let picture = Picture::new(SIDE, SIDE, image)?;
        let run = |count| -> Outcome<f64> {
            let fitted = fit(&picture, &FitSettings::new(count, 3000), &mut |_| ControlFlow::Continue(()))?;
            decibels(&fitted.gaussians, &picture)
        };
        let mut near = truth.clone();
        near.centers.iter_mut().enumerate().for_each(|(i, x)| *x += 0.5 * stream.normal::<f32>(4096 + i as u64));
        let mut settings = FitSettings::new(50, 3000);
        settings.growth = false;
        let near = refine(&picture, &settings, near, &mut |_| ControlFlow::Continue(()))?;
        let near = decibels(&near.gaussians, &picture)?;
        table.row(&format!("seed {seed}"), &[run(50)?, run(100)?, near].map(|x| format!("{x:.2}")));
    }
    Ok(())
}

pub fn run(mut arguments: Arguments) -> Outcome {
    let table: String = arguments.required(TABLES)?;
    let photos: Vec<String> = arguments.rest("photos")?;
    let read = |path: &String| -> Outcome<Picture> {
        let photo = Image::read(path, Background::Black)?;
        let [width, height] = [photo.width, photo.height].map(|side| side.min(SIDE));
        let photo = photo.crop((photo.width - width) / 2, (photo.height - height) / 2, width, height);
        Ok(Picture::new(width, height, photo.pixels)?)
    };
    let pictures = photos.iter().map(read).collect::<Outcome<Vec<_>>>()?;
    match &*table {
        "fits" => fits(&pictures),
        "starts" => starts(&pictures),
        "variants" => variants(&pictures),
        "files" => files(&pictures),
        "colors" => colors(&pictures),
        "planted" => planted(),
        other => Err(format!("expected {TABLES}, found {other}").into()),
    }
}
