//! `splatweaver lift`.

mod demo;
mod features;
mod masks;
mod pca;
mod plan;
mod sampling;
mod valid;

use crate::command::arguments::{Lift, SolverName};
use crate::{
    AggregateOptions, Aggregation, ClusterOptions, Descent, HdbscanOptions, LiftOptions, Lifted, Observations, Raster,
    Solver, Stop, aggregate, cluster, guide, lift,
};
use features::FeatureFiles;
pub use features::refused;
use pca::PcaColors;
use plan::Plan;
use sampling::Lens;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use weaver_command::DrawingOptions;
use weaver_command::camera_files::{self, Size};
use weaver_command::{Console, Failure, Progress};
use weaver_geometry::Camera;
use weaver_io::safetensors::Tensors;
use weaver_io::{Checksum, OutputFolder, SceneFile, read_scene};
use weaver_scene::ActivatedGaussians;
use weaver_splat::RasterSettings;

pub fn run(arguments: &Lift, console: &mut Console) -> Result<(), Failure> {
    if !arguments.demo.is_empty() {
        return demo::run(arguments, console);
    }
    let [scene, cameras, folder, out] = required(arguments)?;
    let more = [&arguments.mask_dir, &arguments.aggregate].into_iter().flatten().map(PathBuf::as_path);
    let read: Vec<&Path> = [scene, cameras, folder].into_iter().chain(more).collect();
    let pictures = if arguments.dry_run { None } else { Some(pictures(out, &read)?) };
    let size = Size { width: arguments.width.map(|w| w as usize), height: arguments.height.map(|h| h as usize) };
    let (frames, distortions): (Vec<_>, Vec<_>) = camera_files::read_with_lenses(cameras, size)?.into_iter().unzip();
    let stems = camera_files::stems(&frames);
    let cameras: Vec<Camera> = frames.iter().map(|frame| frame.camera).collect();
    let lens = |(camera, distortion): (&Camera, _)| Lens { camera: *camera, distortion };
    let lenses: Vec<Lens> = cameras.iter().zip(distortions).map(lens).collect();
    let counts = match &arguments.mask_dir {
        Some(folder) => valid::read(folder, &stems, &lenses)?,
        None => vec![None; stems.len()],
    };
    let mut features = FeatureFiles::open(folder, &stems, &lenses, counts)?;
    let masks = arguments.aggregate.as_deref();
    let masks = masks.map(|folder| masks::read(folder, &stems, &lenses, features.channels())).transpose()?;
    let mut drawn = Drawn::read(scene)?;
    let options = options(arguments);
    let plan = Plan::of(&drawn, &cameras, features.channels(), &options)?;
    if arguments.dry_run {
        return console.print(&plan.text());
    }
    plan.check()?;
    console.note(&plan.line());
    let pictures = pictures.expect("claimed unless this is a dry run");
    pictures.check(stems.iter().map(|stem| format!("{stem}.png")))?;

    let checksum = drawn.checksum();
    guide(&mut drawn.gaussians.opacities, arguments.tikhonov)?;
    let mut raster = Raster::new(drawn.gaussians.as_slices(), &cameras, drawn.settings);
    let work = options.work(cameras.len(), features.channels());
    let mut progress = Progress::new("lift", 0, work, console);
    let mut done = 0;
    let mut lifted = lift(&mut raster, &mut features, &options, &mut || {
        done += 1;
        progress.at(done, work, String::new, console);
    })?;
    progress.finish();
    let cleaned = match masks {
        None => None,
        Some(masks) => {
            console.note(&format!("aggregate: {} Gaussians, each compared with all others", lifted.seen.len()));
            let hdbscan = HdbscanOptions { smallest: arguments.smallest as usize, ..HdbscanOptions::default() };
            let options = ClusterOptions { hdbscan, ..ClusterOptions::default() };
            let labels = cluster(&lifted.features, lifted.channels, &lifted.seen, &options)?;
            let options = AggregateOptions { overlap: arguments.overlap, ..AggregateOptions::default() };
            Some(aggregate(&mut raster, &labels, &masks, &mut lifted.features, &options)?)
        }
    };
    let colors = PcaColors::of(&lifted.features, lifted.channels, &lifted.seen);
    for (view, (camera, stem)) in cameras.iter().zip(&stems).enumerate() {
        colors.draw(&mut raster, view, camera)?.write_png(pictures.file(format!("{stem}.png"))?)?;
    }
    let text = report(&lifted, cleaned.as_ref());
    let numbers = [("channels", lifted.channels), ("gaussians", lifted.seen.len()), ("passes", lifted.passes)];
    let figures = BTreeMap::from(numbers);
    write(lifted, arguments, &checksum, out)?;
    let text = format!("{text}features: {}\npictures: {}", out.display(), pictures.path().display());
    console.answer(arguments.json, &[out, pictures.path()], figures, &text)
}

/// The folder for pictures beside the file for features.
fn pictures(out: &Path, read: &[&Path]) -> Result<OutputFolder, Failure> {
    let stem = out.file_stem().map_or("lifted".into(), |stem| stem.to_string_lossy());
    Ok(OutputFolder::claim(out.with_file_name(format!("{stem}-pictures")), "lift", read)?)
}

/// The required paths without a demonstration; the command line has checked them.
fn required(arguments: &Lift) -> Result<[&Path; 4], Failure> {
    let Lift { scene, cameras, features, out, .. } = arguments;
    match (scene, cameras, features, out) {
        (Some(scene), Some(cameras), Some(features), Some(out)) => Ok([scene, cameras, features, out.as_file()?]),
        _ => Err(Failure::Usage("lift: expected SCENE.ply, --cameras, --features and --out".into())),
    }
}

fn options(arguments: &Lift) -> LiftOptions {
    let stop = Stop { passes: arguments.passes as usize, ..Stop::default() };
    let descent = if arguments.conjugate { Descent::ConjugateGradients } else { Descent::Iteration };
    let solver = match arguments.solver {
        SolverName::RowSum => Solver::RowSum,
        SolverName::Squared => Solver::Squared,
        SolverName::Exact => Solver::Exact { descent, stop },
        SolverName::Damped => Solver::Damped { mu: arguments.mu, stop },
    };
    let (block, least_alpha) = (arguments.block as usize, Some(arguments.least_alpha));
    LiftOptions { block, least_alpha, unit: arguments.unit, ..LiftOptions::with(solver) }
}

/// A file of Gaussians, with its drawing settings.
pub struct Drawn {
    pub gaussians: ActivatedGaussians,
    pub settings: RasterSettings,
    path: PathBuf,
}

impl Drawn {
    /// Reads a scene without its colors, which lifting does not use.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let SceneFile { gaussians, drawing } = read_scene(path)?;
        let (_, settings) = DrawingOptions::default().beside(path, drawing)?;
        let mut gaussians = gaussians.to_activated();
        if gaussians.is_empty() {
            return Err(Failure::message(format!("{}: expected Gaussians, found none", path.display())));
        }
        gaussians.sh = vec![0.0; 3 * gaussians.len()];
        gaussians.degree = 0;
        Ok(Self { gaussians, settings, path: path.to_path_buf() })
    }

    /// Checksum of the geometry, which determines the drawn weights.
    pub fn checksum(&self) -> String {
        let ActivatedGaussians { means, scales, quats, opacities, .. } = &self.gaussians;
        let mut sum = Checksum::default();
        [means, scales, quats, opacities].iter().for_each(|values| sum.floats(values));
        sum.to_string()
    }

    pub fn path(&self) -> &Path {
        &self.path
    }
}

fn report(lifted: &Lifted<f32>, cleaned: Option<&Aggregation>) -> String {
    let coverage = &lifted.coverage;
    let mut text = format!(
        "lifted: {} channels to {} Gaussians in {} passes; {} Gaussians unseen\npixels: {}, of which {} masked and {} hardly covered; mean alpha {:.3}, share off the diagonal {:.3}\n",
        lifted.channels,
        lifted.seen.len(),
        lifted.passes,
        coverage.unseen,
        coverage.rays,
        coverage.masked,
        coverage.dropped,
        coverage.mean_alpha(),
        coverage.off_diagonal()
    );
    if let Some(Aggregation { kept, clusters, without, .. }) = cleaned {
        let agree = kept.iter().filter(|kept| **kept).count();
        text += &format!(
            "aggregated: {clusters} clusters, {without} of them without a mask; {agree} of {} masks agree with one\n",
            kept.len()
        );
    }
    text
}

/// Writes `features` `[P, F]` and `seen` `[P]` with the settings and the scene's checksum.
fn write(lifted: Lifted<f32>, arguments: &Lift, checksum: &str, out: &Path) -> Result<(), Failure> {
    let (splats, channels) = (lifted.seen.len(), lifted.channels);
    let mut tensors = Tensors::default();
    let entries = [
        ("solver", arguments.solver.name().to_string()),
        ("passes", lifted.passes.to_string()),
        ("lambda", arguments.tikhonov.to_string()),
        ("scene_checksum", checksum.to_string()),
        ("aggregated", arguments.aggregate.is_some().to_string()),
    ];
    tensors.metadata.extend(entries.map(|(key, value)| (key.to_string(), value)));
    tensors.insert("features", &[splats, channels], lifted.features);
    tensors.insert("seen", &[splats], lifted.seen);
    tensors.write(out)?;
    Ok(())
}
