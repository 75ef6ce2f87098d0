//! Range images of maps, for meshing, and `splatweaver eval-mesh`.

use crate::command::LidarRunError;
use crate::command::plan::read;
use crate::command::results::{MAP, Summary, TRAJECTORY, surfels};
use crate::command::run::stored;
use clap::{Args, ValueEnum};
use serde_json::json;
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure, Progress, Threads, in_pool, memory};
use weaver_geometry::Pose;
use weaver_io::ply::read_triangles;
use weaver_io::{TrajectoryFile, read_gaussians, read_lidar_scan, read_text};
use weaver_mesh::{
    Benchmark, Chamfer, FAR, Mesh, MeshErrors, RangeView, compare, mesh_chamfer, point_chamfer, thinned,
};
use weaver_run::Folder;
use weaver_surfel::{Limits, RangeImages, Sight, SurfelWorkspace};

/// Sampled points on a square meter of a compared mesh, before thinning.
const PER_AREA: f64 = 5000.0;
/// Side of the cubes that keep one point each, meters.
const THINNED: f64 = 0.02;
/// Bytes of a point while points are thinned, by cubes or by their distance.
const POINT_BYTES: f64 = 100.0;

/// Benchmarks whose way to measure how far a surface is from a reference is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SurfaceBenchmark {
    /// As DTU: millimeters, points 0.2 apart, mean of the distances below 20 within its box; no masks
    Dtu,
    /// One point for each cube of 0.2, mean of the distances, each at most 20; of a mesh its vertices count
    Points,
}

/// Compares a mesh with a cloud of the true surface: accuracy, completeness, Chamfer distance, F-score.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver eval-mesh street.ply truth.ply
  splatweaver eval-mesh scan24.ply stl024_total.ply --benchmark dtu
  splatweaver eval-mesh street.ply truth.pcd --threshold 0.1 --json")]
pub struct EvalMesh {
    /// The mesh, PLY
    #[arg(value_name = "MESH")]
    mesh: PathBuf,
    /// Points of the true surface (.ply, .pcd, .npy, .bin)
    #[arg(value_name = "CLOUD")]
    cloud: PathBuf,
    /// Distance within which points belong together in the F-score, meters
    #[arg(long, value_name = "METERS", default_value_t = 0.2, value_parser = threshold)]
    threshold: f64,
    /// Measures as a benchmark does [default: in meters, points 2 cm apart, errors up to half a meter, and an F-score]
    #[arg(long, value_enum, value_name = "BENCHMARK", conflicts_with = "threshold")]
    benchmark: Option<SurfaceBenchmark>,
    /// Prints figures as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    threads: Threads,
}

/// A finite distance above 0.
fn threshold(text: &str) -> Result<f64, String> {
    let within = |meters: &f64| *meters > 0.0 && meters.is_finite();
    text.parse().ok().filter(within).ok_or(format!("expected meters above 0; found {text}"))
}

/// Draws the map of a run from each of its keyframes, and passes the ranges and normals to a function.
///
/// # Errors
/// When there is no complete run, and as the function's.
pub fn map_views<T>(
    run: &Path,
    console: &mut Console,
    then: impl FnOnce(&[RangeView<'_>], &mut Console) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let plan = stored(run)?;
    let path = run.join(Folder::SUMMARY);
    let summary: Summary = serde_json::from_str(&read_text(&path)?).map_err(|error| LidarRunError::Invalid {
        path: path.clone(),
        what: "figures",
        expected: "those of a lidar run".into(),
        found: error.to_string(),
    })?;
    let trajectory = TrajectoryFile::read(run.join(TRAJECTORY))?;
    let map = surfels(&read_gaussians(run.join(MAP))?);
    let camera = plan.camera(&read(&plan.files()?[0])?);
    let poses: Vec<Pose> =
        summary.keyframes.iter().filter_map(|i| trajectory.poses.get(*i)).map(Pose::inverse).collect();
    let mut workspace = SurfelWorkspace::new();
    let mut drawn = Vec::new();
    let mut progress = Progress::new("mesh", 0, poses.len(), console);
    for (i, pose) in poses.iter().enumerate() {
        let (view, mut images) = ([*pose], RangeImages::default());
        let sight = Sight { surfels: map.slices(), camera: &camera, poses: &view, limits: Limits::default() };
        workspace.draw(&sight, &mut images)?;
        let ranges = images.mean_range().into_iter().zip(&images.opacity);
        let ranges: Vec<f32> = ranges.map(|(r, a)| if *a > 0.5 { r } else { 0.0 }).collect();
        drawn.push((ranges, images.normal));
        progress.at(i + 1, poses.len(), String::new, console);
    }
    progress.finish();
    let views = poses.iter().zip(&drawn);
    let views: Vec<RangeView<'_>> =
        views.map(|(pose, (range, normal))| RangeView { camera: &camera, pose: *pose, range, normal }).collect();
    then(&views, console)
}

/// Runs `splatweaver eval-mesh`.
///
/// Fails on unreadable files, and when no points are left for the comparison.
pub fn eval_mesh(arguments: &EvalMesh, console: &mut Console) -> Result<(), Failure> {
    in_pool(arguments.threads.count(), || {
        let mesh = surface(arguments)?;
        let mut cloud = read_lidar_scan(&arguments.cloud)?.points;
        // Beams without a hit are points that are not finite.
        cloud.retain(|point| point.iter().all(|x| x.is_finite()));
        if let Some(benchmark) = arguments.benchmark {
            return by_benchmark(benchmark, arguments, (&mesh, &cloud), console);
        }
        let (points, cloud) = (thinned(&mesh.sample(PER_AREA, 0), THINNED), thinned(&cloud, THINNED));
        let errors = compare(&points, &cloud, arguments.threshold).ok_or_else(|| {
            let (path, what) = match cloud.is_empty() {
                true => (&arguments.cloud, "points"),
                false => (&arguments.mesh, "area"),
            };
            unusable(path, what, "at least a point to compare", "none")
        })?;
        if arguments.json {
            let figures = json!({
                "accuracy_m": errors.accuracy,
                "completeness_m": errors.completeness,
                "chamfer_m": errors.chamfer,
                "beyond": errors.beyond,
                "precision": errors.precision,
                "recall": errors.recall,
                "f_score": errors.f_score,
            });
            return console.print(&serde_json::to_string_pretty(&figures)?);
        }
        console.print(&text(&errors, arguments.threshold))
    })
}

/// A line for people.
fn text(errors: &MeshErrors, threshold: f64) -> String {
    let MeshErrors { accuracy, completeness, chamfer, beyond, f_score, .. } = errors;
    let centimeters =
        |meters: &Option<f64>| meters.map_or("undefined".into(), |meters| format!("{:.2} cm", 100.0 * meters));
    let [accuracy, chamfer] = [accuracy, chamfer].map(centimeters);
    format!(
        "accuracy {accuracy}, completeness {:.2} cm, Chamfer {chamfer}, F {:.2} % within {threshold} m; {:.2} % of the mesh is beyond {FAR} m",
        100.0 * completeness,
        100.0 * f_score,
        100.0 * beyond
    )
}

/// The mesh for comparison; fails on nonfinite vertices and, if points are sampled, without triangles or with too
/// little memory for the points.
fn surface(arguments: &EvalMesh) -> Result<Mesh, Failure> {
    let path = &arguments.mesh;
    let (vertices, triangles) = read_triangles(path)?;
    let broken = vertices.iter().filter(|vertex| !vertex.iter().all(|x| x.is_finite())).count();
    if broken > 0 {
        return Err(unusable(path, "vertices", "finite numbers", format!("{broken} of {} without", vertices.len())));
    }
    let mesh = Mesh { vertices, triangles };
    let (per_area, unit) = match arguments.benchmark {
        Some(SurfaceBenchmark::Points) => return Ok(mesh),
        Some(SurfaceBenchmark::Dtu) => (Benchmark::DTU.per_area(), "millimeters"),
        None => (PER_AREA, "meters"),
    };
    if mesh.triangles.is_empty() {
        return Err(unusable(path, "triangles", "at least one", "none"));
    }
    let area = mesh.area();
    let advice = format!("{}: is the mesh in {unit}? its area would be {area:.3e} square {unit}", path.display());
    memory::check((area * per_area * POINT_BYTES) as u64, &advice)?;
    Ok(mesh)
}

/// Error of a file that cannot be compared.
fn unusable(path: &Path, what: &'static str, expected: &str, found: impl Into<String>) -> Failure {
    LidarRunError::Invalid { path: path.into(), what, expected: expected.into(), found: found.into() }.into()
}

/// Prints the distances by a benchmark's definition.
fn by_benchmark(
    benchmark: SurfaceBenchmark,
    arguments: &EvalMesh,
    (mesh, cloud): (&Mesh, &[[f32; 3]]),
    console: &mut Console,
) -> Result<(), Failure> {
    let found = match benchmark {
        SurfaceBenchmark::Dtu => mesh_chamfer(mesh, cloud, &Benchmark::DTU, 0),
        SurfaceBenchmark::Points => point_chamfer(&mesh.vertices, cloud, &Benchmark::DTU),
    };
    let Some(Chamfer { accuracy, completeness, chamfer, points }) = found else {
        let expected = format!("a surface in the frame and the unit of {}", arguments.cloud.display());
        return Err(unusable(&arguments.mesh, "mesh", &expected, format!("none within {} of it", Benchmark::DTU.far)));
    };
    if arguments.json {
        let figures =
            json!({ "accuracy": accuracy, "completeness": completeness, "chamfer": chamfer, "points": points });
        return console.print(&serde_json::to_string_pretty(&figures)?);
    }
    let [own, others] = points;
    console.print(&format!(
        "accuracy {accuracy:.3}, completeness {completeness:.3}, Chamfer {chamfer:.3} in the unit of the files; {own} points, {others} of the \
         reference"
    ))
}
