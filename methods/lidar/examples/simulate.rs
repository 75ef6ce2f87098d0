//! Scans of a simulated world:
//! `cargo run --release -p weaver-lidar --features command --example simulate -- FOLDER room|street COUNT
//! [SEED] [moving]`.
//!
//! Writes `FOLDER/scans/NNNN.bin` (or .ply with times, while the sensor moves) and `FOLDER/poses.txt` of a loop through
//! the room, or of a drive along the street, half a meter from scan to scan, `truth.ply`, the visible points of its
//! surfaces, and `mesh.ply`.

use std::path::Path;
use weaver_geometry::glam::DVec3;
use weaver_io::ply::{write_points, write_triangles};
use weaver_io::{TrajectoryFile, TrajectoryFormat, write_lidar_scan, write_text};
use weaver_procedural::lidar::{LidarWorld, SpinningSensor, between, room_loop, street_drive};
use weaver_scene::PointCloud;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder = Path::new(arguments.first().ok_or("expected a folder")?);
    let count: usize = arguments.get(2).ok_or("expected a number of scans")?.parse()?;
    let seed: u64 = arguments.get(3).map_or(Ok(0), |n| n.parse())?;
    let moving = arguments.get(4).is_some_and(|word| word == "moving");
    let (world, mut poses) = match arguments.get(1).map(String::as_str) {
        Some("room") => (LidarWorld::room(), room_loop(count)),
        Some("street") => (LidarWorld::street(seed), street_drive(count + 1, 0.5)),
        _ => return Err("expected room or street".into()),
    };
    // Pose at the end of the last sweep.
    let end = if poses.len() > count { poses.remove(count) } else { poses[0] };
    std::fs::create_dir_all(folder.join("scans"))?;
    for (i, pose) in poses.iter().enumerate() {
        let next = poses.get(i + 1).copied().unwrap_or(end);
        let motion = |t: f64| if moving { between(pose, &next, t) } else { *pose };
        let sweep = SpinningSensor::default().sweep(&world, motion, seed, i as u64);
        if !moving {
            write_lidar_scan(folder.join(format!("scans/{i:04}.bin")), &sweep.points)?;
            continue;
        }
        let n = sweep.points.len();
        let mut text = format!("ply\nformat ascii 1.0\nelement vertex {n}\n");
        ["x", "y", "z", "time"].iter().for_each(|name| text += &format!("property float {name}\n"));
        text += "end_header\n";
        sweep.points.iter().zip(&sweep.times).for_each(|([x, y, z], t)| text += &format!("{x} {y} {z} {t}\n"));
        write_text(folder.join(format!("scans/{i:04}.ply")), &text)?;
    }
    let exact = SpinningSensor { rows: 128, columns: 2048, noise: 0.0, divergence: 0.0, ..Default::default() };
    let mut seen = PointCloud::default();
    for (i, pose) in poses.iter().enumerate().step_by(4) {
        let sweep = exact.sweep(&world, |_| *pose, seed, i as u64);
        let moved = |p: &[f32; 3]| pose.apply(DVec3::from_array(p.map(f64::from))).to_array().map(|x| x as f32);
        seen.positions.extend(sweep.points.iter().step_by(3).map(moved));
    }
    seen.colors = vec![[128; 3]; seen.positions.len()];
    write_points(folder.join("truth.ply"), &seen)?;
    let (vertices, triangles) = world.mesh();
    write_triangles(folder.join("mesh.ply"), &vertices, &[], &triangles)?;
    let times = (0..count).map(|i| i as f64).collect();
    TrajectoryFile { poses, times }.write(folder.join("poses.txt"), TrajectoryFormat::Tum)?;
    println!("{count} scans: {}", folder.display());
    Ok(())
}
