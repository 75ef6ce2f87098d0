//! `splatweaver render`.

use clap::{ArgGroup, Args};
use serde_json::json;
use std::path::{Path, PathBuf};
use weaver_clip::{Film, Gif, PictureSink, VIDEOS, Video, WebP};
use weaver_command::camera_files::{self, Size};
use weaver_command::{
    Console, DeviceFlag, DrawingFlags, DrawingOptions, Failure, Output, Progress, Projection, Threads, choice, device,
    memory, projection, rate,
};
use weaver_io::{Image, OutputFolder, SceneFile, read_scene};
use weaver_scene::{CameraPath, Frame, Gaussians, middle};
use weaver_splat::Renderer;

/// Draws a file of Gaussians from given cameras or along an orbit.
///
/// One PNG per camera, named after its photo where the names are distinct, else numbered; or a video, with an ffmpeg on
/// the PATH; or a GIF; or a WebP; or all of them.
#[derive(Args, Debug)]
#[command(group(ArgGroup::new("film").multiple(true).args(["video", "gif", "webp"])))]
#[command(group(ArgGroup::new("viewpoints").required(true).args(["cameras", "orbit"])))]
#[command(after_help = "Examples:
  splatweaver render scene.ply --cameras transforms.json -o renders
  splatweaver render scene.ply --cameras capture/sparse/0 --width 640 -o renders
  splatweaver render scene.ply --cameras clip.txt --width 640 --height 360 -o renders
  splatweaver render scene.ply --cameras transforms.json --path ellipse --width 480 --gif around.gif
  splatweaver render scene.ply --orbit 90 --background 0,0,0 -o turn
  splatweaver render scene.ply --cameras transforms.json --projection equirectangular -o spheres
  splatweaver render scene.ply --orbit 120 --width 1280 --height 720 --video turn.mp4")]
pub struct Render {
    /// The Gaussians: PLY as 3DGS stores them, or another format of `splatweaver convert`
    #[arg(value_name = "SCENE.ply")]
    pub scene: PathBuf,
    /// transforms.json, a folder with a COLMAP model, or a RealEstate10K camera file
    #[arg(long, value_name = "FILE")]
    pub cameras: Option<PathBuf>,
    /// Cameras on a circle around the scene instead, this many
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub orbit: Option<u32>,
    /// A path along these cameras in place of the cameras themselves
    #[arg(long, value_parser = choice(&PATHS), conflicts_with = "orbit")]
    pub path: Option<CameraPath>,
    /// Cameras of the path
    #[arg(long, value_name = "N", default_value_t = 120, value_parser = clap::value_parser!(u32).range(2..=100_000), requires = "path")]
    pub pictures: u32,
    /// Lens of the pictures: pinhole, equirectangular (the whole sphere), or fisheye:DEGREES, a full angle
    #[arg(long, value_name = "equirectangular|pinhole|fisheye:DEGREES", default_value = "pinhole", value_parser = projection)]
    pub projection: Projection,
    /// Folder for the pictures
    #[arg(short, long, value_name = "DIR", required_unless_present = "film", value_parser = Output::folder())]
    pub out: Option<Output>,
    /// Makes a video of the pictures, in the cameras' order
    #[arg(long, value_name = "FILE.mp4", value_parser = Output::file(VIDEOS))]
    pub video: Option<Output>,
    /// Makes a GIF of the pictures, in the cameras' order, of 256 colors each
    #[arg(long, value_name = "FILE.gif", value_parser = Output::file(&["gif"]))]
    pub gif: Option<Output>,
    /// Makes a WebP of the pictures, in the cameras' order, without loss
    #[arg(long, value_name = "FILE.webp", value_parser = Output::file(&["webp"]))]
    pub webp: Option<Output>,
    /// Pictures of the video, GIF or WebP per second
    #[arg(long, value_name = "F", default_value = "30", value_parser = rate(), requires = "film")]
    pub fps: f64,
    /// Width in pixels; intrinsics follow [default: the cameras', 640 for an orbit, 2048 for a sphere, 1024 for a
    /// fisheye]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub width: Option<u32>,
    /// Height in pixels; intrinsics follow [default: the cameras' aspect ratio, 3/4 of the width for an orbit, half of
    /// it for a sphere, the width for a fisheye]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub height: Option<u32>,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub device: DeviceFlag,
    #[command(flatten)]
    pub threads: Threads,
    // Last: its heading would be that of what follows.
    #[command(flatten)]
    pub drawing: DrawingFlags,
}

/// Paths along cameras.
const PATHS: [(&str, CameraPath, &str); 3] = [
    ("ellipse", CameraPath::Ellipse, "Around what the cameras look at, as far away and as high as they are"),
    ("spline", CameraPath::Spline, "Through the cameras in their order, smoothed"),
    ("dolly", CameraPath::Dolly, "From behind the middle camera toward what it looks at, and back"),
];

/// Width of an orbit's pictures.
const WIDTH: usize = 640;

pub fn run(arguments: &Render, console: &mut Console) -> Result<(), Failure> {
    let read: Vec<&Path> = std::iter::once(&arguments.scene).chain(&arguments.cameras).map(PathBuf::as_path).collect();
    let out = arguments.out.as_ref().map(|folder| OutputFolder::claim(folder, "render", &read)).transpose()?;
    let size = Size { width: arguments.width.map(|w| w as usize), height: arguments.height.map(|h| h as usize) };
    let plane = arguments.projection == Projection::Pinhole;
    if let (false, Some(device)) = (plane, device::name(&arguments.device)) {
        let expected = "expected --device cpu, which alone draws through a lens";
        return Err(Failure::Usage(format!("--projection: {expected}, found --device {device}")));
    }
    let SceneFile { gaussians, drawing } = read_scene(&arguments.scene)?;
    let mut cameras = match (&arguments.cameras, arguments.orbit) {
        (Some(file), _) => {
            let cameras = if plane { camera_files::read(file, size)? } else { camera_files::read_poses(file)? };
            match arguments.path {
                Some(path) => path.along(&cameras, arguments.pictures as usize, middle(&gaussians).unwrap_or_default()),
                None => cameras,
            }
        }
        (None, count) => orbit(&gaussians, count.unwrap_or(1) as usize, size).ok_or_else(|| {
            Failure::message(format!("{}: expected Gaussians to turn around, found none", arguments.scene.display()))
        })?,
    };
    for frame in &mut cameras {
        frame.camera = arguments.projection.camera(frame.camera.pose, size)?.unwrap_or(frame.camera);
    }
    let (background, settings) = DrawingOptions::from(arguments.drawing).beside(&arguments.scene, drawing)?;
    let mut renderer = Renderer::new(device::rasterizer(&arguments.device)?);
    let stems = camera_files::stems(&cameras);
    out.as_ref().map_or(Ok(()), |out| out.check(stems.iter().map(|stem| format!("{stem}.png"))))?;
    let at_once = rayon::current_num_threads().min(MOST_WAITING).min(cameras.len());
    memory::check(
        memory::of_pictures(&cameras, at_once),
        "a smaller --width and --height, or fewer --threads, reduce it",
    )?;
    let mut output = PictureSink { folder: out.as_ref(), films: films(arguments, &cameras)? };
    let activated = gaussians.to_activated();
    let mut progress = Progress::new("render", 0, cameras.len(), console);
    let model = arguments.projection.model();
    output.fill(&stems, at_once, |i| -> Result<Image, Failure> {
        let camera = cameras[i].camera;
        let pixels = renderer.render_through(model, &activated, &[camera], background, &settings)?.concat();
        progress.at(i + 1, cameras.len(), String::new, console);
        Ok(Image { width: camera.width, height: camera.height, pixels })
    })?;
    progress.finish();
    let outputs = output.finish()?;
    let places: Vec<String> = outputs.iter().map(|path| path.display().to_string()).collect();
    let (pictures, gaussians, places) = (cameras.len(), gaussians.len(), places.join(" and "));
    let figures = json!({ "pictures": pictures, "gaussians": gaussians });
    let text = format!("pictures: {pictures} of {gaussians} Gaussians, in {places}");
    console.answer(arguments.json, &outputs, figures, &text)
}

/// Pictures that wait to be written.
const MOST_WAITING: usize = 8;

/// Opens the files of moving pictures.
fn films(arguments: &Render, cameras: &[Frame]) -> Result<Vec<Box<dyn Film>>, Failure> {
    let Render { video, gif, webp, fps, .. } = arguments;
    let size = |view: &Frame| (view.camera.width, view.camera.height);
    let first = cameras.first().map(size).unwrap_or_default();
    let flags = [("--video", video), ("--gif", gif), ("--webp", webp)];
    let flag = flags.iter().find(|(_, path)| path.is_some());
    let other = cameras.iter().map(size).find(|other| *other != first);
    if let (Some(other), Some((flag, _))) = (other, flag) {
        let sizes = format!("{}x{} and {}x{}", first.0, first.1, other.0, other.1);
        return Err(Failure::Usage(format!("{flag}: pictures of {sizes}; --width and --height make them equal")));
    }
    let mut films: Vec<Box<dyn Film>> = Vec::new();
    if let Some(path) = video {
        films.push(Box::new(Video::create(path, first, *fps)?));
    }
    if let Some(path) = gif {
        films.push(Box::new(Gif::create(path, first, *fps)?));
    }
    if let Some(path) = webp {
        films.push(Box::new(WebP::create(path, first, *fps)?));
    }
    Ok(films)
}

/// Cameras on a circle around the scene; `None` of a scene without Gaussians.
fn orbit(gaussians: &Gaussians, count: usize, size: Size) -> Option<Vec<Frame>> {
    let width = size.width.or(size.height.map(|h| (h * 4).div_ceil(3))).unwrap_or(WIDTH);
    let height = size.height.unwrap_or((width * 3).div_ceil(4));
    let cameras = weaver_scene::orbit(gaussians, count, [width, height])?;
    let named = |(i, camera)| Frame::new(format!("{i:04}"), camera);
    Some(cameras.into_iter().enumerate().map(named).collect())
}
