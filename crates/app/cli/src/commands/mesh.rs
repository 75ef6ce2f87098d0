//! `splatweaver mesh`.

use crate::methods::map_views;
use clap::Args;
use serde_json::json;
use std::path::{Path, PathBuf};
use weaver_command::camera_files::{self, Size};
use weaver_command::{Console, ConsoleObserver, DrawingFlags, DrawingOptions, Failure, Output, Threads};
use weaver_geometry::Camera;
use weaver_io::{SURFACE_FORMATS, Surface};
use weaver_mesh::{DrawnScene, SceneScale};
use weaver_reconstruct::{SceneSurface, SurfaceOptions, TexturePhotos};

/// Cells of the map of a lidar run, meters, and of its truncation.
const MAP_VOXEL: f64 = 0.1;
const MAP_TRUNCATION: f64 = 3.0;

/// Makes a mesh of a scene as its cameras see it, or of the map of a lidar run.
///
/// Drawn depth is averaged as truncated signed distances, whose zero level becomes triangles by surface nets; vertices
/// of scenes take the colors that cameras see, and of their pieces the 50 largest of at least 50 triangles stay.
/// Edges collapse by quadric errors, and textures are blended from the photos.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver mesh scene -o surface.ply
  splatweaver mesh scene.ply --cameras capture/transforms.json --far 8 -o surface.ply
  splatweaver mesh scene --triangles 100000 --texture --watertight -o model.glb
  splatweaver mesh runs/street --voxel 0.05 -o street.ply --json")]
pub struct Meshing {
    /// The folder of a result, a file of Gaussians, or the folder of a run of `lidar` that is complete
    #[arg(value_name = "SCENE")]
    scene: PathBuf,
    /// transforms.json, a folder with a COLMAP model, or a RealEstate10K camera file [default: the transforms.json of
    /// the folder]
    #[arg(long, value_name = "FILE")]
    cameras: Option<PathBuf>,
    /// The mesh: .ply, .glb, or .obj with its texture beside
    #[arg(short, long, value_name = "FILE", default_value = "mesh.ply", value_parser = Output::file(SURFACE_FORMATS))]
    out: Output,
    /// The most triangles [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(4..))]
    triangles: Option<u32>,
    /// Paints a texture from the photos of the cameras, of so many texels a side [default: 4096 where it is named]
    #[arg(long, value_name = "SIZE", num_args = 0..=1, default_missing_value = "4096", value_parser = clap::value_parser!(u32).range(64..=16_384))]
    texture: Option<u32>,
    /// Closes the holes that no photo saw, so that the mesh bounds a solid
    #[arg(long)]
    watertight: bool,
    /// Side of a cell, world units [default: 0.1 m of a map; of a scene a 256th of the cameras' distance, and at least
    /// a pixel]
    #[arg(long, value_name = "DISTANCE")]
    voxel: Option<f64>,
    /// Distance from a camera beyond which everything is background, world units [default: twice the least distance of
    /// a camera from the point that all look at]
    #[arg(long, value_name = "DISTANCE")]
    far: Option<f64>,
    /// Longest side that photos are shrunk to, for drawing
    #[arg(long, value_name = "PIXELS", default_value_t = 800, value_parser = clap::value_parser!(u32).range(16..))]
    long_side: u32,
    /// Prints figures as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    pub threads: Threads,
    // Last: its heading would be that of what follows.
    #[command(flatten)]
    drawing: DrawingFlags,
}

pub fn run(arguments: &Meshing, console: &mut Console) -> Result<(), Failure> {
    let Meshing { scene, out, texture, .. } = arguments;
    Surface::check(out, texture.is_some())?;
    let file = if scene.is_dir() { scene.join("scene.ply") } else { scene.clone() };
    let is_map = scene.is_dir() && !file.exists();
    let made = if is_map { map_mesh(scene, arguments, console)? } else { scene_mesh(&file, arguments, console)? };
    made.write(out)?;
    let mesh = made.mesh;
    let (vertices, triangles, area) = (mesh.vertices.len(), mesh.triangles.len(), mesh.area());
    let (area_key, unit) = if is_map { ("area_m2", "m^2") } else { ("area", "square units") };
    let figures = json!({ "vertices": vertices, "triangles": triangles, area_key: area });
    let text = format!("{}: {vertices} vertices, {triangles} triangles, {area:.1} {unit}", out.display());
    console.answer(arguments.json, &[out], figures, &text)
}

impl Meshing {
    fn options(&self, voxel: f64) -> SurfaceOptions {
        SurfaceOptions { voxel, triangles: self.triangles.map(|most| most as usize), watertight: self.watertight }
    }
}

/// The mesh of the map of a lidar run, as its keyframes see it.
fn map_mesh(run: &Path, arguments: &Meshing, console: &mut Console) -> Result<SceneSurface, Failure> {
    if arguments.texture.is_some() {
        return Err(Failure::Usage(format!("{}: expected photos with --texture, found a lidar run", run.display())));
    }
    let options = arguments.options(arguments.voxel.unwrap_or(MAP_VOXEL));
    map_views(run, console, |views, console| {
        let cut = (MAP_TRUNCATION * options.voxel, false);
        Ok(options.surface(views, cut, |_| Vec::new(), &mut ConsoleObserver::new(console))?)
    })
}

/// The mesh of a scene, with the colors of its vertices or a texture.
fn scene_mesh(file: &Path, arguments: &Meshing, console: &mut Console) -> Result<SceneSurface, Failure> {
    let (gaussians, background, settings) = DrawingOptions::from(arguments.drawing).read(file)?;
    let beside = arguments.scene.is_dir().then(|| arguments.scene.join("transforms.json"));
    let path = arguments.cameras.clone().or(beside.filter(|path| path.exists())).ok_or_else(|| {
        Failure::Usage(format!("{}: expected --cameras with a scene that has none beside it", file.display()))
    })?;
    let frames = camera_files::read(&path, Size::default())?;
    let photos = arguments.texture.map(|size| Ok::<_, Failure>((TexturePhotos::of(&path)?, size))).transpose()?;
    let cameras: Vec<Camera> = frames.iter().map(|frame| frame.camera.shrunk(arguments.long_side as usize)).collect();
    let SceneScale { far, voxel } = SceneScale::of(&cameras, arguments.far, arguments.voxel).ok_or_else(|| {
        let path = path.display();
        Failure::Usage(format!("{path}: expected --far with cameras that look at no common point before them"))
    })?;
    let mut scene = DrawnScene::new(&gaussians, background, settings, far).carving();
    let observe = &mut ConsoleObserver::new(console);
    let mut surface = arguments.options(voxel).scene(&mut scene, &cameras, observe)?;
    if surface.mesh.triangles.is_empty() {
        let file = file.display();
        let found = format!("found none nearer than {far:.3} of {} cameras", cameras.len());
        return Err(Failure::message(format!("{file}: expected a surface, {found}; --far sets another distance")));
    }
    if let Some((photos, size)) = photos {
        photos.paint(&mut surface, size as usize, observe)?;
    }
    Ok(surface)
}
