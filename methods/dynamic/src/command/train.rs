//! `splatweaver dynamic train`, and the common parts of all trainings.

use super::eval;
use super::film::scene_page;
use crate::run::{DerivedFrom, ExpertKind, FilmSource, Preset, Run, RunSettings, Stage};
use clap::Args;
use std::path::{Path, PathBuf};
use weaver_command::{
    Console, Failure, Interrupt, LiveFlag, MOST_SEED, Output, Progress, ShellCommand, Threads, choice, duration,
};
use weaver_io::safetensors::Tensors;
use weaver_run::Folder;
use weaver_view_run::{Listener, LiveRun, LiveView, Server, live};

/// Trains experts one after the other, then their router, and writes a run folder: model.safetensors, logs,
/// report.html.
///
/// Ctrl-C saves a checkpoint and ends; --resume goes on to the same bits as an uninterrupted run.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver dynamic train --out runs/film
  splatweaver dynamic train --experts keys,poly --steps 500 --router-steps 300 --out runs/try
  splatweaver dynamic train --data lego --experts field,code --long-side 400 --out runs/lego
  splatweaver dynamic train --resume runs/film")]
pub struct DynamicTrain {
    /// Folder of a film: transforms_train.json (D-NeRF), poses_bounds.npy (Neural 3D Video) or scene.json (HyperNeRF)
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Longest side of the photos, pixels [default: 96 of generated films, else what the layout's benchmarks take]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(16..=8192))]
    pub long_side: Option<u32>,
    /// Cameras and frames of a generated film
    #[arg(long, value_name = "CxF", default_value = "9x32", value_parser = shots, conflicts_with = "data")]
    pub shots: [usize; 2],
    /// The experts: field (4DGaussians), code (E-D3DGS), keys (Ex4DGS), poly (Spacetime Gaussians); at least two
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "field,code,keys,poly")]
    pub experts: Vec<ExpertKind>,
    /// Sizes of the experts
    #[arg(long, value_parser = choice(&PRESETS), default_value = "tiny")]
    pub preset: Preset,
    /// Gaussians of each expert
    #[arg(long, value_name = "N", default_value = "2500", value_parser = clap::value_parser!(u32).range(32..=10_000_000))]
    pub gaussians: u32,
    /// Steps of each expert
    #[arg(long, value_name = "N", default_value = "3000", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub steps: u32,
    /// Steps of the router
    #[arg(long, value_name = "N", default_value = "2000", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub router_steps: u32,
    /// With `none`, trains on the photos that are held out, too: nothing is left to judge by
    #[arg(long, value_name = "listed|none", default_value = "listed", value_parser = ["listed", "none"])]
    pub hold_out: String,
    /// Divisor of the gate's logits, in training and in use
    #[arg(long, value_name = "T", default_value = "1")]
    pub temperature: f64,
    /// Values that the router sees where an expert has nothing
    #[arg(long, value_name = "B", default_value = "1", allow_negative_numbers = true)]
    pub background_weight: f64,
    /// Seed of the generated film, of numbers and of order
    #[arg(long, value_name = "S", default_value = "0", value_parser = clap::value_parser!(u64).range(..=MOST_SEED))]
    pub seed: u64,
    /// Folder of the run [default: the first free one of runs/dynamic-1, runs/dynamic-2, ...]
    #[arg(short, long, value_name = "DIR", value_parser = Output::folder())]
    pub out: Option<Output>,
    /// Goes on from the checkpoint of a run that was stopped, with what it was started with
    #[arg(long, value_name = "RUN", conflicts_with_all = [
        "data", "long_side", "shots", "experts", "preset", "gaussians", "steps", "router_steps", "hold_out",
        "temperature", "background_weight", "seed", "out",
    ])]
    pub resume: Option<PathBuf>,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub live: LiveFlag,
    #[command(flatten)]
    pub threads: Threads,
}

const PRESETS: [(&str, Preset, &str); 2] =
    [("tiny", Preset::Tiny, "For minutes on a processor"), ("published", Preset::Published, "As published")];

/// Seconds between checkpoints.
const SAVE_EVERY: f64 = 60.0;
/// Longest side of a generated film's photos, and the other.
const SIZE: [usize; 2] = [96, 72];

pub fn run(arguments: &DynamicTrain, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let live = Listener::of(arguments.live)?;
    if let Some(folder) = &arguments.resume {
        return finish(Run::resume(folder)?, (folder, live, arguments.json), console, interrupt);
    }
    let size = arguments.long_side.map(|size| size as usize);
    let film = match &arguments.data {
        Some(path) => FilmSource::Folder { path: path.clone(), long_side: size },
        None => {
            let width = size.unwrap_or(SIZE[0]);
            FilmSource::Procedural {
                seed: arguments.seed,
                size: [width, width * SIZE[1] / SIZE[0]],
                shots: arguments.shots,
            }
        }
    };
    let experts = (0..arguments.experts.len()).map(|index| Stage::Expert { index, steps: arguments.steps as usize });
    let settings = RunSettings {
        film,
        experts: arguments.experts.clone(),
        preset: arguments.preset,
        gaussians: arguments.gaussians as usize,
        all: arguments.hold_out == "none",
        stages: experts.chain([Stage::Router { steps: arguments.router_steps as usize }]).collect(),
        temperature: arguments.temperature,
        background_weight: arguments.background_weight,
        seed: arguments.seed,
        save_every: SAVE_EVERY,
        derived_from: None,
    };
    let out = arguments.out.as_deref().map_or_else(|| Folder::free(Path::new("runs"), "dynamic"), Path::to_path_buf);
    begin((&out, live, arguments.json), settings, None, console, interrupt)
}

/// Trains a run derived from another.
pub fn derive(
    run: &Run,
    from: &Path,
    (stages, by): (Vec<Stage>, String),
    (out, live, json): (&Path, Option<Listener>, bool),
    tensors: Tensors,
    (console, interrupt): (&mut Console, &Interrupt),
) -> Result<(), Failure> {
    let settings =
        RunSettings { stages, derived_from: Some(DerivedFrom { from: from.into(), by }), ..run.settings().clone() };
    begin((out, live, json), settings, Some(tensors), console, interrupt)
}

fn begin(
    (folder, live, json): (&Path, Option<Listener>, bool),
    settings: RunSettings,
    init: Option<Tensors>,
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let run = Run::create(folder, settings, init)?;
    let film = run.film();
    let [height, width] = film.size;
    let counts: usize = run.mixture().counts().iter().sum();
    console.note(&format!(
        "{}: {} photos of {width} x {height} to train on, {} held out; {counts} Gaussians",
        film.name,
        run.training().len(),
        film.shots.len() - run.training().len()
    ));
    film.remarks.iter().for_each(|remark| console.note(&format!("note: {remark}")));
    finish(run, (folder, live, json), console, interrupt)
}

fn finish(
    mut run: Run,
    (folder, listener, json): (&Path, Option<Listener>, bool),
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let [done, steps] = run.steps();
    let (scenes, stop) = (run.scenes(), interrupt.watch_after("this step"));
    let scene_page = listener.is_some().then(|| scene_page(&run, run.expert_at_hand(), folder)).transpose()?;
    let followed = LiveRun { folder, steps, names: &[], showing: LiveView::Film(&scenes), stop };
    let shown = scene_page.as_ref().zip(listener);
    let server = shown.map(|(scene_page, listener)| Server::new(scene_page, Some(followed), listener)).transpose()?;
    if server.is_some() {
        run.follow();
    }
    let mut progress = Progress::new("train", done, steps, console);
    let complete = live(server, console, |console| {
        run.advance(stop, |report| {
            let shown = || format!("{}, loss {:.4}", report.stage, report.loss);
            progress.at(report.step, report.of, shown, console);
        })
    })?;
    progress.finish();
    if !complete {
        let [done, steps] = run.steps();
        let resume = ShellCommand::new("splatweaver dynamic train --resume").path(folder);
        console.note(&format!("saved at step {done} of {steps}; to go on: {resume}"));
        return Ok(());
    }
    let evaluation = eval::judge(&run, console)?;
    let seconds: f64 = evaluation.seconds.iter().sum();
    console.note(&format!("{steps} steps done in {}: {}", duration(seconds), folder.display()));
    eval::answer(&evaluation, folder, json, console)
}

/// Cameras and frames from `CxF`.
fn shots(text: &str) -> Result<[usize; 2], String> {
    let parts = text.split_once('x').map(|(cameras, frames)| (cameras.parse(), frames.parse()));
    match parts {
        Some((Ok(cameras @ 2..=64), Ok(frames @ 4..=1000))) => Ok([cameras, frames]),
        _ => Err("expected 2 to 64 cameras and 4 to 1000 frames, as in 9x32".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shots_are_cameras_and_frames() {
        assert_eq!(shots("9x32"), Ok([9, 32]));
        assert!(shots("1x32").is_err() && shots("9").is_err() && shots("9x3").is_err());
    }
}
