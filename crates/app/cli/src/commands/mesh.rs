//! `splatweaver mesh`.

use crate::methods::map_views;
use clap::Args;
use serde_json::json;
use std::path::{Path, PathBuf};
use weaver_command::camera_files::{self, Size};
use weaver_command::{Console, DrawingFlags, DrawingOptions, Failure, Output, Progress, Threads, memory};
use weaver_geometry::Camera;
use weaver_io::ply::write_triangles;
use weaver_mesh::{DistanceField, DrawnScene, FieldProgress, Mesh, RangeView, SceneScale};

/// Cells of the map of a lidar run, meters.
const MAP_VOXEL: f64 = 0.1;
/// Cells of the truncation, of a scene and of a map.
const TRUNCATION: f64 = 5.0;
const MAP_TRUNCATION: f64 = 3.0;
/// The largest pieces that are kept, and the least triangles of each.
const PIECES: (usize, usize) = (50, 50);

/// Makes a mesh of a scene as its cameras see it, or of the map of a lidar run.
///
/// Drawn depth is averaged as truncated signed distances, whose zero level becomes triangles by surface nets; vertices
/// of scenes take the colors that cameras see, and of their pieces the 50 largest of at least 50 triangles stay.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver mesh scene -o surface.ply
  splatweaver mesh scene.ply --cameras capture/transforms.json --far 8 -o surface.ply
  splatweaver mesh runs/street --voxel 0.05 -o street.ply --json")]
pub struct Meshing {
    /// The folder of a result, a file of Gaussians, or the folder of a run of `lidar` that is complete
    #[arg(value_name = "SCENE")]
    scene: PathBuf,
    /// transforms.json, a folder with a COLMAP model, or a RealEstate10K camera file [default: the transforms.json of
    /// the folder]
    #[arg(long, value_name = "FILE")]
    cameras: Option<PathBuf>,
    /// The mesh, PLY
    #[arg(short, long, value_name = "FILE", default_value = "mesh.ply", value_parser = Output::file(&["ply"]))]
    out: Output,
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
    let Meshing { scene, out, .. } = arguments;
    let file = if scene.is_dir() { scene.join("scene.ply") } else { scene.clone() };
    let is_map = scene.is_dir() && !file.exists();
    let (mesh, colors) = match is_map {
        true => (map_mesh(scene, arguments.voxel.unwrap_or(MAP_VOXEL), console)?, Vec::new()),
        false => scene_mesh(&file, arguments, console)?,
    };
    write_triangles(out, &mesh.vertices, &colors, &mesh.triangles)?;
    let (vertices, triangles, area) = (mesh.vertices.len(), mesh.triangles.len(), mesh.area());
    let (area_key, unit) = if is_map { ("area_m2", "m^2") } else { ("area", "square units") };
    let figures = json!({ "vertices": vertices, "triangles": triangles, area_key: area });
    let text = format!("{}: {vertices} vertices, {triangles} triangles, {area:.1} {unit}", out.display());
    console.answer(arguments.json, &[out], figures, &text)
}

/// The mesh of the map of a lidar run, as its keyframes see it.
fn map_mesh(run: &Path, voxel: f64, console: &mut Console) -> Result<Mesh, Failure> {
    map_views(run, console, |views, console| Ok(distance_field(views, voxel, MAP_TRUNCATION * voxel, console)?.mesh()))
}

/// The mesh of a scene, and the colors of its vertices.
fn scene_mesh(file: &Path, arguments: &Meshing, console: &mut Console) -> Result<(Mesh, Vec<[u8; 3]>), Failure> {
    let (gaussians, background, settings) = DrawingOptions::from(arguments.drawing).read(file)?;
    let beside = arguments.scene.is_dir().then(|| arguments.scene.join("transforms.json"));
    let path = arguments.cameras.clone().or(beside.filter(|path| path.exists())).ok_or_else(|| {
        Failure::Usage(format!("{}: expected --cameras with a scene that has none beside it", file.display()))
    })?;
    let frames = camera_files::read(&path, Size::default())?;
    let cameras: Vec<Camera> = frames.iter().map(|frame| frame.camera.shrunk(arguments.long_side as usize)).collect();
    let SceneScale { far, voxel } = SceneScale::of(&cameras, arguments.far, arguments.voxel).ok_or_else(|| {
        let path = path.display();
        Failure::Usage(format!("{path}: expected --far with cameras that look at no common point before them"))
    })?;
    let mut scene = DrawnScene::new(&gaussians, background, settings, far).carving();
    let mut progress = Progress::new("mesh", 0, cameras.len(), console);
    for (i, camera) in cameras.iter().enumerate() {
        scene.add(camera)?;
        progress.at(i + 1, cameras.len(), String::new, console);
    }
    progress.finish();
    let (most, least) = PIECES;
    let mesh = distance_field(&scene.views(), voxel, TRUNCATION * voxel, console)?.mesh().largest_pieces(most, least);
    if mesh.triangles.is_empty() {
        let file = file.display();
        let found = format!("found none nearer than {far:.3} of {} cameras", cameras.len());
        return Err(Failure::message(format!("{file}: expected a surface, {found}; --far sets another distance")));
    }
    let colors = scene.colors(&mesh.vertices, TRUNCATION * voxel);
    Ok((mesh, colors))
}

/// The field of range images, with its progress.
///
/// Fails where memory is too small for the blocks, as soon as so many are found.
fn distance_field(
    views: &[RangeView<'_>],
    voxel: f64,
    truncation: f64,
    console: &mut Console,
) -> Result<DistanceField, Failure> {
    let advice = format!("cells twice as wide (--voxel {}) take a quarter", 2.0 * voxel);
    let mut progress = Progress::new("field", 0, views.len(), console);
    let field = DistanceField::watched(views, voxel, truncation, |FieldProgress { done, of, bytes }| {
        if done <= views.len() {
            memory::check(bytes, &advice)?;
        }
        progress.at(done, of, String::new, console);
        Ok::<(), Failure>(())
    })?;
    progress.finish();
    Ok(field)
}
