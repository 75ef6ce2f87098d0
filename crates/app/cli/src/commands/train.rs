//! `splatweaver train`.

use crate::methods;
use crate::processes::{network, together};
use clap::Args;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use weaver_command::{
    Console, DeviceFlag, Failure, Interrupt, LiveFlag, MOST_SEED, MOST_THREADS, Output, Progress, ShellCommand, device,
    duration, in_pool,
};
use weaver_inference::RunFolder;
use weaver_trainer::{
    CURVES, ConfigSource, Folder, Ranks, ResolvedConfig, StepReport, Summary, Training, claim_run, reclaim_run,
};
use weaver_view_run::{Listener, LiveRun, LiveView, Server, live};

/// Headings of groups of flags.
const CONFIGURATION: &str = "Configuration";
const RUN: &str = "Run";
const MEASURING: &str = "Measuring";

/// Trains a model and writes a run folder: checkpoint, logs, sample pictures, report.html.
///
/// Without --data it trains on built-in procedural scenes. Ctrl-C saves a checkpoint and ends; --resume goes on to the
/// same bits as an uninterrupted run.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver train
  splatweaver train --preset micro --steps 20 --out /tmp/try
  splatweaver train --data fox --data fern --set stages.1.rate=5e-4 --set data.pool=8
  splatweaver train --resume runs/tiny-1
  splatweaver train --resume runs/tiny-1 --steps 8000
  splatweaver train --init runs/tiny-1 --data fox --steps 1000
  splatweaver train --preset tiny-endless --set data.endless=none --init built-in --data fox --steps 1500
  splatweaver train --data photos --teacher model.safetensors --preset tiny-published
  splatweaver train --preset small --dry-run
  splatweaver train --steps 20 --trace step.json")]
pub struct Train {
    /// Folder of a capture (COLMAP, transforms.json, NeRF-synthetic, RealEstate10K); may be repeated
    #[arg(long, value_name = "DIR", help_heading = "Data")]
    pub data: Vec<PathBuf>,
    /// For --data of photos without cameras: a published checkpoint, VGGT's or SplatWeaver's, from which they get
    /// cameras and depth; both are kept beside the photos, in teacher.safetensors
    #[arg(long, value_name = "FILE", requires = "data", help_heading = "Data")]
    pub teacher: Option<PathBuf>,
    /// The model to train [default: splatweaver]
    #[arg(long, value_name = "NAME", help_heading = CONFIGURATION)]
    pub model: Option<String>,
    /// Where the configuration starts from: micro, tiny, tiny-endless, tiny-published, tiny-dagger, small or medium
    /// [default: the file's, or tiny]
    #[arg(long, help_heading = CONFIGURATION)]
    pub preset: Option<String>,
    /// Configuration file (TOML) between the preset and the flags; `splatweaver config` prints one to start from
    #[arg(long, value_name = "FILE", help_heading = CONFIGURATION)]
    pub config: Option<PathBuf>,
    /// Sets a configuration value by its path, list entries by number; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE", help_heading = CONFIGURATION)]
    pub settings: Vec<String>,
    /// Steps in all; the stages are rescaled in proportion. With --resume: the last stage becomes longer, and its rate
    /// follows the longer cosine from then on
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), help_heading = CONFIGURATION)]
    pub steps: Option<u32>,
    /// Seed of weights, data order and noise
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u64).range(..=MOST_SEED), help_heading = CONFIGURATION)]
    pub seed: Option<u64>,
    /// Folder of the run [default: the first free runs/PRESET-N]
    #[arg(short, long, value_name = "DIR", help_heading = RUN, value_parser = Output::folder())]
    pub out: Option<Output>,
    /// Starts from the averaged weights of this run or checkpoint, of whichever model, from a published checkpoint, or
    /// with `built-in` from those that come with the program, as far as they fit; the weights that were taken are named
    #[arg(long, value_name = "built-in|RUN|FILE", help_heading = RUN)]
    pub init: Option<PathBuf>,
    /// Goes on with this run, with its own configuration
    #[arg(long, value_name = "RUN", help_heading = RUN, conflicts_with_all = ["model", "preset", "data", "teacher", "out", "init", "seed", "settings", "config"])]
    pub resume: Option<PathBuf>,
    /// Threads. Does not change results [default: the configuration's, or one per core]
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u16).range(1..=MOST_THREADS), help_heading = RUN)]
    pub threads: Option<u16>,
    /// Measures the memory of the run (parameters, activations, optimizer, peak) on a few steps of each stage, and
    /// writes nothing
    #[arg(long, conflicts_with_all = ["out", "trace", "live"], help_heading = MEASURING)]
    pub dry_run: bool,
    /// Writes every op of one step of each stage into this file, in Chrome's trace format (chrome://tracing, Perfetto)
    #[arg(long, value_name = "FILE.json", help_heading = MEASURING, value_parser = Output::file(&["json"]))]
    pub trace: Option<Output>,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long, help_heading = RUN)]
    pub json: bool,
    #[command(flatten)]
    pub live: LiveFlag,
    #[command(flatten)]
    pub device: DeviceFlag,
}

pub fn run(arguments: &Train, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    together(console, |ranks, console| run_in(arguments, ranks, console, interrupt))
}

/// Trains alone, or with the other processes.
fn run_in(
    arguments: &Train,
    ranks: Option<&Arc<dyn Ranks>>,
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    // The first process alone has a folder and says how it goes.
    let follows = ranks.is_some_and(|ranks| ranks.rank() > 0);
    if follows && arguments.dry_run {
        return Ok(());
    }
    let writes = !(arguments.dry_run || follows);
    let listener = if follows { None } else { Listener::of(arguments.live)? };
    let joined = |mut session: Box<dyn Training>| -> Result<Option<Box<dyn Training>>, Failure> {
        if let Some(ranks) = ranks.filter(|_| !arguments.dry_run) {
            session.share(ranks.clone())?;
        }
        if follows {
            session.follow()?;
            return Ok(None);
        }
        Ok(Some(session))
    };
    let registry = methods::models();
    let rasterizer = device::rasterizer(&arguments.device)?;
    let resumed = arguments.resume.as_deref().map(RunFolder::at);
    let (entry, config) = match &resumed {
        Some(folder) => {
            let entry = registry.of_run(folder)?;
            (entry, entry.read(folder)?)
        }
        None => {
            let entry = registry.find_for(arguments.model.as_deref(), arguments.preset.as_deref())?;
            (entry, entry.resolve(&source(arguments))?)
        }
    };
    if let Some(trace) = &arguments.trace {
        weaver_io::check_output_file(trace, &config.inputs)?;
    }
    // Claimed before anything is read; nothing is left behind when the data cannot be.
    let claim = || match (&arguments.resume, &arguments.out) {
        (Some(path), _) => reclaim_run(path),
        (None, Some(out)) => claim_run(out, &config),
        (None, None) => claim_run(&Folder::free(Path::new("runs"), &config.preset), &config),
    };
    let claimed = writes.then(claim).transpose()?;
    in_pool(arguments.threads.map(usize::from).or(config.threads), || {
        let mut session = match &resumed {
            Some(folder) => entry.resume(folder, arguments.steps.map(|steps| steps as usize))?,
            None => entry.start(&config)?,
        };
        session.draw_by(rasterizer);
        let Some(session) = joined(session)? else { return Ok(()) };
        let Some(claimed) = &claimed else {
            return dry_run(session, &config, console);
        };
        if resumed.is_none() {
            claimed.store_text(&config.toml)?;
        }
        train(session, claimed, arguments, listener, console, interrupt)
    })
}

/// Sources of the configuration of a new run.
fn source(arguments: &Train) -> ConfigSource {
    ConfigSource {
        preset: arguments.preset.clone(),
        file: arguments.config.clone(),
        settings: arguments.settings.clone(),
        data: arguments.data.clone(),
        init: arguments.init.clone(),
        teacher: arguments.teacher.clone(),
        seed: arguments.seed,
        threads: arguments.threads.map(usize::from),
        steps: arguments.steps.map(|steps| steps as usize),
    }
}

/// Measures the resources of the run. Nothing is left behind.
fn dry_run(session: Box<dyn Training>, config: &ResolvedConfig, console: &mut Console) -> Result<(), Failure> {
    console.print(session.plan().trim_end())?;
    let path = std::env::temp_dir().join(format!("splatweaver-dry-run-{}", std::process::id()));
    // The folder for temporary files itself may not exist.
    let made: Vec<&Path> = path.ancestors().take_while(|p| !p.as_os_str().is_empty() && !p.exists()).skip(1).collect();
    let folder = claim_run(&path, config)?;
    let measured = session.dry_run(&folder);
    drop(folder);
    std::fs::remove_dir_all(&path)?;
    made.into_iter().try_for_each(std::fs::remove_dir)?;
    let measured = measured?;
    console.print(&measured.to_string())?;
    // Stages differ; the shortest batch gains least.
    let batches = measured.batches.max(1);
    let shortest = measured.stages.iter().map(|stage| stage.step.as_secs_f64()).fold(f64::INFINITY, f64::min);
    console.print(&network(measured.parameters as u64, batches, shortest / batches as f64))?;
    if let Some(peak) = weaver_io::peak_mb() {
        console.print(&format!("{:<28}{peak:>9.1} MB, photos and program included", "peak"))?;
    }
    Ok(())
}

fn train(
    mut session: Box<dyn Training>,
    folder: &Folder,
    arguments: &Train,
    listener: Option<Listener>,
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    if let Some(path) = &arguments.trace {
        session.trace_to(&std::path::absolute(path)?);
    }
    let path = folder.path().display().to_string();
    console.note(session.plan().trim_end());
    console.note(&format!("run folder {path}"));
    let (done, total) = session.steps();
    let label = session.labeler();
    let stop = interrupt.watch_after("this step");
    let samples = RunFolder::at(folder.path()).samples_path();
    let (names, showing) = (&CURVES, LiveView::Pictures(&samples));
    let followed = LiveRun { folder: folder.path(), steps: total, names, showing, stop };
    let server = listener.map(|listener| Server::of_run(&path, followed, listener)).transpose()?;
    let summary = live(server, console, |console| {
        let mut progress = Progress::new("train", done, total, console);
        let mut show = |report: &StepReport| {
            progress.at(report.step, total, || label(report), console);
            Ok(())
        };
        let result = session.train(folder, &mut show, stop);
        progress.finish();
        result
    })?;
    report(&summary, folder, arguments.json, console)
}

fn report(summary: &Summary, folder: &Folder, json: bool, console: &mut Console) -> Result<(), Failure> {
    let Summary { steps, planned, .. } = summary;
    if steps < planned {
        let resume = ShellCommand::new("splatweaver train --resume").path(folder.path());
        console.note(&format!("saved at step {steps} of {planned}; to go on: {resume}"));
        return Ok(());
    }
    let memory = weaver_io::peak_mb().map_or(String::new(), |peak| format!(", at most {peak:.1} MB of memory"));
    console.note(&format!("{steps} steps done, {} in this session{memory}", duration(summary.seconds)));
    let table = summary.evaluation.as_ref().map_or(String::new(), |evaluation| evaluation.table());
    let report = folder.path().join(Folder::REPORT);
    let text = format!("{table}report: {}", report.display());
    console.answer(json, &[report], summary, &text)
}
