//! `splatweaver view`.

use crate::methods;
use clap::Args;
use std::path::PathBuf;
use weaver_command::{Console, DrawingFlags, Failure, Interrupt, Output, Threads, positive};
use weaver_reconstruct::Outcome;
use weaver_view::HtmlOptions;
use weaver_view_run::{Access, Listener, PageFile, SceneFiles, ScenePage, serve};

/// The file by which a folder of `dynamic train` is recognized.
const MIXTURE: &str = "model.safetensors";

/// Shows a scene in the browser, or writes it as one HTML file.
///
/// The page is served to this machine alone, unless --host is said. A folder of `fit`, `reconstruct` or `infer` is
/// opened with its cameras, photos and report, one of `lidar` with its map and report, one of `dynamic train` with a
/// slider for the time.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver view scene
  splatweaver view scene.ply --cameras capture/transforms.json --open
  splatweaver view scene.spz --html scene.html
  splatweaver view edited.ply scene.ply               one beside the other
  splatweaver view scene --port 8080                  at a port that `ssh -L` can be told before")]
pub struct View {
    /// A file of Gaussians, or the folder of a result
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// Another file of Gaussians in the same coordinates, right of a slider
    #[arg(value_name = "SECOND")]
    pub second: Option<PathBuf>,
    /// transforms.json, a folder with a COLMAP model, or a RealEstate10K camera file [default: the transforms.json of
    /// the folder]
    #[arg(long, value_name = "FILE")]
    pub cameras: Option<PathBuf>,
    /// Folder with the photos of the cameras, found by the ends of their paths [default: where the cameras say that
    /// they are]
    #[arg(long, value_name = "DIR", requires = "cameras")]
    pub photos: Option<PathBuf>,
    /// Features that `lift` gave the Gaussians: the page shows places like a clicked point [default: the
    /// lifted.safetensors of the folder]
    #[arg(long, value_name = "FILE", conflicts_with = "html")]
    pub lifted: Option<PathBuf>,
    /// Meters of a unit of the scene, for a scale bar [default: 1 for a run of `lidar`, else no bar]
    #[arg(long, value_name = "METERS", value_parser = positive())]
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
    /// Writes all Gaussians, even if the file has more than 200 MB
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
    let page = page(arguments)?;
    let View { html, lossless, yes, open, host, port, .. } = arguments;
    if let Some(path) = html {
        let (options, moments) = (HtmlOptions { lossless: *lossless }, arguments.moments.into());
        return PageFile { path, options, moments, any_size: *yes }.write(&page, *open, console);
    }
    let access = if *host { Access::Network } else { Access::Local };
    if *host {
        console.warning(
            "everybody in the network who has the address can look at the scene and save changed ones beside it",
        );
    }
    serve(&page, Listener::bind(access, *port)?, *open, console, interrupt)
}

/// The scene with everything that is shown of it.
fn page(arguments: &View) -> Result<ScenePage, Failure> {
    let View { scene, cameras, photos, lifted, meters, expert, html, drawing, .. } = arguments;
    let drawing = (*drawing).into();
    let files = SceneFiles { scene, cameras: cameras.as_deref(), photos: photos.as_deref(), drawing };
    if scene.join(MIXTURE).is_file() && !files.has_scene() {
        if cameras.is_some() || lifted.is_some() {
            let expected = "expected a scene that does not move, found the mixture of";
            return Err(Failure::Usage(format!("--cameras, --lifted: {expected} {}", scene.display())));
        }
        return methods::film(scene, expert.as_deref(), drawing, *meters);
    }
    if expert.is_some() {
        let scene = scene.display();
        return Err(Failure::Usage(format!("--expert: expected the folder of `dynamic train`, found {scene}")));
    }
    let mut page = files.page()?;
    if let Some(path) = &arguments.second {
        page.second = Some((path.display().to_string(), SceneFiles::of(path).page()?.gaussians));
    }
    let coverage = Outcome::beside(scene.join("scene.ply")).map(|outcome| outcome.coverage).unwrap_or_default();
    page.shots.iter_mut().for_each(|shot| shot.coverage = coverage.of(&shot.name));
    page.look.meters = meters.or(page.look.meters);
    if html.is_none() {
        page.features = files.features(lifted.as_deref(), page.gaussians.len())?;
    }
    Ok(page)
}
