//! `splatweaver view`.

use crate::methods;
use clap::Args;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use weaver_command::{Console, DrawingFlags, DrawingOptions, Failure, Interrupt, LiftedFile, Output, Threads, in_pool};
use weaver_io::{SceneFile, SceneFormat, read_scene, write_text};
use weaver_reconstruct::{Coverage, Outcome};
use weaver_view::{HtmlOptions, Look};
use weaver_view_run::{Access, Features, Listener, ScenePage, Server, overview};

/// Scenes in folders, the best first: of fits and networks, of lidar runs, and a scene in many files.
const RESULTS: [&str; 3] = ["scene.ply", MAP, "meta.json"];
/// The map of a lidar run.
const MAP: &str = "map.ply";
/// Features that were lifted to the scene of a folder.
const LIFTED: &str = "lifted.safetensors";
/// The file by which a folder of `dynamic train` is told.
const MIXTURE: &str = "model.safetensors";
/// Megabytes of a page above which there is a warning.
const LARGE: f64 = 60.0;
/// Megabytes of a page above which it is written only with --yes.
const TOO_LARGE: f64 = 200.0;

/// Shows a scene in the browser, or writes it as one HTML file.
///
/// The page is served to this machine alone, unless --host is said. A folder of `fit`, `reconstruct` or `infer` is opened with its cameras,
/// photos and report, one of `lidar` with its map and report, one of `dynamic train` with a slider for the time.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver view scene
  splatweaver view scene.ply --cameras capture/transforms.json --open
  splatweaver view scene.spz --html scene.html
  splatweaver view scene --port 8080                  at a port that `ssh -L` can be told before")]
pub struct View {
    /// A file of Gaussians, or the folder of a result
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// transforms.json, a folder with a COLMAP model, or a RealEstate10K camera file [default: the transforms.json of the folder]
    #[arg(long, value_name = "FILE")]
    pub cameras: Option<PathBuf>,
    /// Folder with the photos of the cameras, found by the ends of their paths [default: where the cameras say that they are]
    #[arg(long, value_name = "DIR", requires = "cameras")]
    pub photos: Option<PathBuf>,
    /// Features that `lift` gave the Gaussians: the page shows what is like a point that is clicked [default: the lifted.safetensors of the folder]
    #[arg(long, value_name = "FILE", conflicts_with = "html")]
    pub lifted: Option<PathBuf>,
    /// Meters of a unit of the scene, for a scale bar [default: 1 for a run of `lidar`, else no bar]
    #[arg(long, value_name = "METERS", value_parser = meters)]
    pub meters: Option<f64>,
    /// Expert of a mixture of moving Gaussians that is shown [default: the one that was trained last]
    #[arg(long, value_name = "NAME")]
    pub expert: Option<String>,
    /// Writes one HTML file that needs nothing else, in place of a server
    #[arg(long, value_name = "FILE", value_parser = Output::file(&["html", "htm"]))]
    pub html: Option<Output>,
    /// Moments of a moving scene that the file holds, evenly spread over the film
    #[arg(long, requires = "html", value_name = "N", default_value = "31", value_parser = clap::value_parser!(u16).range(2..=1000))]
    pub moments: u16,
    /// Keeps every bit of the scene in the file; else it is rounded as SPZ does
    #[arg(long, requires = "html")]
    pub lossless: bool,
    /// Writes the file even if it has more than 200 MB
    #[arg(long, requires = "html")]
    pub yes: bool,
    /// Asks the desktop to open the page
    #[arg(long)]
    pub open: bool,
    /// Serves everybody in the network who has the address with its token
    #[arg(long, conflicts_with = "html")]
    pub host: bool,
    /// Port that the page is served at [default: a free one]
    #[arg(long, value_name = "N", conflicts_with = "html", value_parser = clap::value_parser!(u16).range(1..))]
    pub port: Option<u16>,
    #[command(flatten)]
    pub threads: Threads,
    // Last: its heading would be that of what follows.
    #[command(flatten)]
    pub drawing: DrawingFlags,
}

pub fn run(arguments: &View, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    in_pool(arguments.threads.count(), || {
        let View { scene, cameras, photos, drawing, .. } = arguments;
        if scene.join(MIXTURE).is_file() && !scene.join(RESULTS[0]).exists() {
            return film(arguments, console, interrupt);
        }
        if arguments.expert.is_some() {
            let scene = scene.display();
            return Err(Failure::Usage(format!("--expert: expected the folder of `dynamic train`, found {scene}")));
        }
        let seen = Seen { scene, cameras: cameras.as_deref(), photos: photos.as_deref(), drawing: (*drawing).into() };
        let mut scene_page = scene_page(&seen)?;
        scene_page.look.meters = arguments.meters.or(scene_page.look.meters);
        scene_page.features = features(arguments, scene_page.gaussians.len())?;
        show(&scene_page, arguments, console, interrupt)
    })
}

fn show(scene_page: &ScenePage, arguments: &View, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    match &arguments.html {
        Some(file) => write(scene_page, file, arguments, console),
        None => serve(scene_page, arguments, console, interrupt),
    }
}

/// The lifted features of a scene, if there are such and somebody may ask for them.
fn features(arguments: &View, gaussians: usize) -> Result<Option<Features>, Failure> {
    let beside = || Some(arguments.scene.join(LIFTED)).filter(|path| arguments.html.is_none() && path.is_file());
    let Some(path) = arguments.lifted.clone().or_else(beside) else { return Ok(None) };
    let lifted = LiftedFile::read(&path, &arguments.scene, gaussians)?;
    Ok(Some(Features::new(lifted.features().to_vec(), lifted.channels)))
}

fn meters(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|x| *x > 0.0 && f64::is_finite(*x)).ok_or_else(|| "expected a positive number".into())
}

/// Shows an expert of a mixture of moving Gaussians at any time.
fn film(arguments: &View, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let folder = &arguments.scene;
    if arguments.cameras.is_some() || arguments.lifted.is_some() {
        let folder = folder.display();
        let message =
            format!("--cameras, --lifted: expected a scene that does not move, found the mixture of {folder}");
        return Err(Failure::Usage(message));
    }
    let (drawing, meters) = (arguments.drawing.into(), arguments.meters);
    let scene_page = methods::film(folder, arguments.expert.as_deref(), drawing, meters)?;
    show(&scene_page, arguments, console, interrupt)
}

/// A scene and what belongs to it, as files.
#[derive(Debug)]
pub struct Seen<'a> {
    scene: &'a Path,
    cameras: Option<&'a Path>,
    photos: Option<&'a Path>,
    drawing: DrawingOptions,
}

impl<'a> Seen<'a> {
    /// A file of Gaussians or the folder of a result, with everything as it says.
    pub fn of(scene: &'a Path) -> Self {
        Self { scene, cameras: None, photos: None, drawing: DrawingOptions::default() }
    }
}

/// Reads a scene with its cameras.
pub fn scene_page(seen: &Seen<'_>) -> Result<ScenePage, Failure> {
    let folder = seen.scene.is_dir().then_some(seen.scene);
    let within = |name: &str| folder.map(|folder| folder.join(name)).filter(|path| path.exists());
    let file = match folder {
        Some(folder) => RESULTS.iter().find_map(|name| within(name)).ok_or_else(|| {
            let (folder, names) = (folder.display(), RESULTS.join(", "));
            Failure::message(format!("{folder}: expected a folder with one of {names}, found none of them"))
        })?,
        None if seen.scene.exists() => seen.scene.to_path_buf(),
        None => {
            let (path, formats) = (seen.scene.display(), SceneFormat::extensions());
            return Err(Failure::message(format!(
                "{path}: expected a file of Gaussians ({formats}) or the folder of a result, found neither"
            )));
        }
    };
    let SceneFile { gaussians, drawing } = read_scene(&file)?;
    let (background, settings) = seen.drawing.beside(&file, drawing)?;
    let named = folder.unwrap_or(&file);
    let absolute = std::path::absolute(named).unwrap_or_else(|_| named.into());
    let title = absolute.file_name().map_or("scene".into(), |name| name.to_string_lossy().into_owned());
    let mut scene_page = ScenePage::new(title, gaussians, Look { background, settings, ..Look::default() });
    if let Some(cameras) = seen.cameras.map(PathBuf::from).or_else(|| within("transforms.json")) {
        scene_page = scene_page.with_cameras(&cameras, seen.photos)?;
        let coverage = folder.and_then(coverage).unwrap_or_default();
        scene_page.shots.iter_mut().for_each(|shot| shot.coverage = coverage.of(&shot.name));
    }
    if file.ends_with(MAP) {
        scene_page.shots.push(overview());
        scene_page.look.meters = Some(1.0);
    }
    scene_page.report = within("report.html");
    scene_page.file = Some(file);
    Ok(scene_page)
}

/// The part of each photo that others agree about, as the summary of a fit says.
fn coverage(folder: &Path) -> Option<Coverage> {
    let summary = weaver_io::read_text(folder.join("summary.json")).ok()?;
    Some(serde_json::from_str::<Outcome>(&summary).ok()?.coverage)
}

fn write(scene_page: &ScenePage, file: &Path, arguments: &View, console: &mut Console) -> Result<(), Failure> {
    let options = HtmlOptions { lossless: arguments.lossless };
    let page = match &scene_page.moving {
        Some(_) => scene_page.film_html(arguments.moments as usize, options)?,
        None => scene_page.html(options)?,
    };
    let megabytes = page.len() as f64 / 1e6;
    match weighed(megabytes, arguments.yes) {
        Weight::Small => {}
        Weight::Large => console.note(&format!("warning: the page has {megabytes:.0} MB, more than phones may open")),
        Weight::TooLarge => {
            let file = file.display();
            return Err(Failure::message(format!(
                "{file}: the page has {megabytes:.0} MB, which many browsers do not open; --yes writes it all the same, `splatweaver view` without --html needs no file"
            )));
        }
    }
    write_text(file, &page)?;
    if arguments.open {
        open(&file.display().to_string(), console);
    }
    console.print(&format!("page: {} Gaussians, {megabytes:.1} MB, in {}", scene_page.gaussians.len(), file.display()))
}

/// Judgment of the size of a page.
#[derive(Debug, PartialEq, Eq)]
enum Weight {
    Small,
    Large,
    TooLarge,
}

fn weighed(megabytes: f64, yes: bool) -> Weight {
    if megabytes > TOO_LARGE && !yes {
        Weight::TooLarge
    } else if megabytes > LARGE {
        Weight::Large
    } else {
        Weight::Small
    }
}

fn serve(
    scene_page: &ScenePage,
    arguments: &View,
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let access = if arguments.host { Access::Network } else { Access::Local };
    if arguments.host {
        console.note("warning: everybody in the network who has the address can look at the scene and save changed ones beside it");
    }
    let server = Server::new(scene_page, None, Listener::bind(access, arguments.port)?)?;
    // First, for it opens here as well.
    if let Some(address) = server.network_address() {
        console.print(&address)?;
    }
    console.print(&server.address())?;
    console.note("Ctrl-C ends the server");
    if arguments.open {
        open(&server.address(), console);
    }
    server.run(interrupt.watch());
    Ok(())
}

/// Asks the desktop to open an address or a file.
pub fn open(address: &str, console: &mut Console) {
    let program = if cfg!(target_os = "macos") {
        "open"
    } else if cfg!(windows) {
        "explorer"
    } else {
        "xdg-open"
    };
    let mut command = Command::new(program);
    let quiet = command.arg(address).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    if quiet.spawn().is_err() {
        console.note(&format!("note: found no {program}, which would open the page"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Large pages are warned of and larger ones need a word.
    #[test]
    fn large_pages_are_warned_of() {
        let weights = [(59.0, false), (61.0, false), (199.0, false), (201.0, false), (201.0, true)]
            .map(|(mb, yes)| weighed(mb, yes));
        assert_eq!(weights, [Weight::Small, Weight::Large, Weight::Large, Weight::TooLarge, Weight::Large]);
    }
}
