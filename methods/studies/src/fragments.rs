//! Lidar odometry on five published scans: `fragments FOLDER [VARIANT..]`.
//!
//! The folder has `planes_NNNNNN.bin` and `edges_NNNNNN.bin`, or `NNNNNN.bin`, of x y z in 32 bits, and `graph.txt` of
//! `name x y z qx qy qz qw`. Tables of odometry and of held-out scans, or of registration pair by pair where the clouds
//! are no scans.

use crate::Outcome;
use crate::arguments::Arguments;
use crate::table::{Table, note};
use std::path::{Path, PathBuf};
use std::time::Instant;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Pose, so3};
use weaver_lidar::{
    Frame, GeometricSettings, LossWeights, MapSettings, Mapper, NormalTarget, Odometry, PatchTree, RangeMean, Scan,
    SurfelCamera, TrackSettings, held_out, register, trajectory_errors,
};

/// Scans with the poses of the reference.
struct Fragment {
    scans: Vec<Scan>,
    poses: Vec<Pose>,
}

fn points(path: &Path) -> Outcome<Vec<[f32; 3]>> {
    let bytes = std::fs::read(path)?;
    let number = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
    Ok(bytes.chunks_exact(12).map(|p| [number(p), number(&p[4..]), number(&p[8..])]).collect())
}

fn load(folder: &Path) -> Outcome<Fragment> {
    let text = std::fs::read_to_string(folder.join("graph.txt"))?;
    let line = |line: &str| -> Option<Pose> {
        let x: Vec<f64> = line.split_whitespace().skip(1).map_while(|x| x.parse().ok()).collect();
        (x.len() == 7).then(|| Pose::from_wxyz([x[6], x[3], x[4], x[5]], DVec3::from_slice(&x[..3])))
    };
    let poses: Vec<Pose> = text.lines().filter_map(line).collect();
    let mut names: Vec<_> =
        std::fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<std::io::Result<_>>()?;
    names.retain(|path| path.extension().is_some_and(|e| e == "bin") && !path.to_string_lossy().contains("edges_"));
    names.sort();
    let scan = |path: &std::path::PathBuf| -> Outcome<Scan> {
        let mut all = points(path)?;
        let edges = path.to_string_lossy().replace("planes_", "edges_");
        if edges != path.to_string_lossy() {
            all.extend(points(Path::new(&edges))?);
        }
        Ok(Scan::new(all))
    };
    Ok(Fragment { scans: names.iter().map(scan).collect::<Outcome<_>>()?, poses })
}

fn camera(scan: &Scan) -> SurfelCamera {
    let [low, high] = scan.elevations();
    let margin = 0.5_f64.to_radians();
    SurfelCamera::spherical([1024, 128], [low - margin, high + margin])
}

/// A row of odometry.
fn odometry(fragment: &Fragment, map: MapSettings, track: TrackSettings, table: &Table, name: &str) -> Outcome {
    let Fragment { scans, poses: truth } = fragment;
    let begun = Instant::now();
    let mut odometry = Odometry::new(&camera(&scans[0]), [1.0, 60.0], map, track, None)?;
    let mut lost = 0;
    for scan in scans {
        lost += usize::from(odometry.add(scan, name)?.lost.is_some());
    }
    let e = trajectory_errors(odometry.poses(), truth);
    let cells = [
        format!("{:.2}", 100.0 * e.rpe),
        format!("{:.2}", e.rpe_percent.unwrap_or(f64::NAN)),
        format!("{:.3}", e.rpe_degrees),
        format!("{:.2}", 100.0 * e.ate),
        lost.to_string(),
        odometry.mapper().state().count.to_string(),
        odometry.mapper().surfels().len().to_string(),
        format!("{:.1}", begun.elapsed().as_secs_f64()),
    ];
    table.row(name, &cells);
    Ok(())
}

/// For each scan, the share of its rays within 0.2 m of the drawn map of the others; the same share for their points as
/// a range image; surfels; seconds.
fn held(fragment: &Fragment, map: &MapSettings, table: &Table, name: &str) -> Outcome {
    let Fragment { scans, poses } = fragment;
    let camera = camera(&scans[0]);
    let begun = Instant::now();
    let mut shares = Vec::new();
    let (mut surfels, mut median) = (0, 0.0);
    for (out, scan) in scans.iter().enumerate() {
        let mut mapper = Mapper::new(&camera, map.clone())?;
        let mut merged = Vec::new();
        for (i, other) in scans.iter().enumerate().filter(|(i, _)| *i != out) {
            let (kept, _) = other.within([1.0, 60.0]);
            mapper.add(i, Frame::new(&kept, &camera, "scan")?, poses[i])?;
            let to = poses[out].inverse().compose(&poses[i]);
            merged.extend(
                kept.points.iter().map(|p| to.apply(DVec3::from_array(p.map(f64::from))).to_array().map(|x| x as f32)),
            );
        }
        let (kept, _) = scan.within([1.0, 60.0]);
        let [share, middle] = held_out(&mut mapper, &kept.points, &poses[out], 0.2)?;
        let buffer = Frame::new(&Scan::new(merged), &camera, "points")?;
        let near = kept.points.iter().filter(|p| {
            let p = DVec3::from_array(p.map(f64::from));
            let at = camera.project(p);
            let (column, row) = (at.x as usize % camera.width, at.y as usize);
            row < camera.height && (f64::from(buffer.range[row * camera.width + column]) - p.length()).abs() < 0.2
        });
        shares.push([share, near.count() as f64 / kept.points.len() as f64]);
        if out == 2 {
            (surfels, median) = (mapper.surfels().len(), middle);
        }
    }
    let text = |k: usize| shares.iter().map(|s| format!("{:.1}", 100.0 * s[k])).collect::<Vec<_>>().join(" ");
    let seconds = format!("{:.1}", begun.elapsed().as_secs_f64());
    table.row(name, &[text(0), surfels.to_string(), format!("{:.1}", 100.0 * median), text(1), seconds]);
    Ok(())
}

/// Errors of registration pair by pair, from perturbed poses.
fn pairs(Fragment { scans, poses }: &Fragment) {
    let table = Table::new("Pairs", &["error of each, cm"]);
    let vectors = |s: &Scan| s.points.iter().map(|p| DVec3::from_array(p.map(f64::from))).collect::<Vec<_>>();
    for (meters, degrees) in [(0.5, 2.0), (1.0, 5.0), (2.0, 10.0)] {
        for (steps, widened) in [(10, 1.0), (30, 1.0), (30, 3.0), (30, 5.0), (30, 10.0)] {
            let settings = GeometricSettings { steps, widened, ..Default::default() };
            let errors = scans.windows(2).enumerate().map(|(i, pair)| {
                let truth = poses[i].inverse().compose(&poses[i + 1]);
                let side = [DVec3::X, DVec3::Y, -DVec3::X, -DVec3::Y][i % 4];
                let turn = if i % 2 == 0 { degrees } else { -degrees };
                let off = Pose::new(so3::exp(DVec3::Z * f64::to_radians(turn)), side * meters);
                let tree = PatchTree::new(&vectors(&pair[0]));
                let found = register(&vectors(&pair[1]), &tree, &truth.compose(&off), &settings);
                match found {
                    Ok(found) => {
                        format!("{:.2}", 100.0 * truth.inverse().compose(&found.pose).translation.length())
                    }
                    Err(lost) => lost.to_string(),
                }
            });
            let errors: Vec<String> = errors.collect();
            let name = format!("from {meters} m, {degrees} deg, {steps} steps, gate x{widened}");
            table.row(&name, &[errors.join(" ")]);
        }
    }
}

pub fn run(mut arguments: Arguments) -> Outcome {
    let folder: PathBuf = arguments.required("a folder")?;
    let named: Vec<String> = arguments.rest("variants")?;
    let fragment = load(&folder)?;
    if let Err(reason) = fragment.scans[0].check_single("the first cloud") {
        note(&reason.to_string());
        pairs(&fragment);
        return Ok(());
    }
    let base = MapSettings::default();
    let with = |loss: LossWeights| MapSettings { loss, ..base.clone() };
    let mean = |map: MapSettings| MapSettings { scale_mean: true, ..map };
    let no_normals = with(LossWeights { normal: 0.0, ..base.loss });
    let no_opacity = with(LossWeights { opacity: 0.0, ..base.loss });
    let drawn_normals = with(LossWeights { target: NormalTarget::Drawn, ..base.loss });
    let mut variants = vec![
        ("published", MapSettings::published()),
        ("default", base.clone()),
        ("unfitted", MapSettings { iterations: 0, ..base.clone() }),
        ("all", MapSettings { density: 1.0, ..base.clone() }),
        ("image-mean", with(LossWeights { range: RangeMean::Image, ..base.loss })),
        ("more-opacity", with(LossWeights { opacity: 0.4, ..base.loss })),
        ("drawn-normals", drawn_normals.clone()),
        ("no-normals", no_normals.clone()),
        ("no-opacity", no_opacity.clone()),
        ("scale-mean", mean(base.clone())),
        ("scale-mean, more-opacity", mean(with(LossWeights { opacity: 0.4, ..base.loss }))),
        ("scale-mean, drawn-normals", mean(drawn_normals)),
        ("scale-mean, no-normals", mean(no_normals)),
        ("scale-mean, no-opacity", mean(no_opacity)),
    ];
    variants.retain(|(name, _)| named.is_empty() || named.iter().any(|other| other == name));
    let columns = ["RPE, cm", "RPE, %", "RPE, deg", "ATE, cm", "lost", "keyframes", "surfels", "s"];
    let table = Table::new("Odometry", &columns);
    for (name, map) in &variants {
        for seed in 0..3 {
            let map = MapSettings { seed, ..map.clone() };
            odometry(&fragment, map, TrackSettings::default(), &table, &format!("{name}, seed {seed}"))?;
        }
    }
    let map = MapSettings { density: 1.0, iterations: 60, ..base };
    let without = TrackSettings { range_steps: 0, ..TrackSettings::default() };
    odometry(&fragment, map, without, &table, "all, 60 steps, without ranges")?;
    let columns = ["rays drawn, %", "surfels of scan 2", "its median, cm", "rays of points, %", "s"];
    let table = Table::new("Held out: rays within 0.2 m", &columns);
    for (name, map) in &variants {
        held(&fragment, map, &table, name)?;
    }
    Ok(())
}
