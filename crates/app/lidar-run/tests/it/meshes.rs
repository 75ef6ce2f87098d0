//! Meshes of runs.

use crate::commands::{SMALL, command, scans, text};
use clap::Parser;
use weaver_command::Console;
use weaver_data::lidar::LidarWorld;
use weaver_io::ply::write_triangles;
use weaver_lidar_run::{EvalMesh, eval_mesh, map_mesh};
use weaver_scene::PointCloud;

#[derive(Parser)]
struct EvalLine {
    #[command(flatten)]
    line: EvalMesh,
}

#[test]
fn a_map_becomes_a_mesh_near_the_room() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(folder.path().join(name));
    scans(folder.path(), 4);
    let (scans, poses, out) = (at("scans"), at("poses.txt"), at("run"));
    command(&[&[scans.as_str(), "--poses", &poses, "--out", &out][..], &SMALL].concat()).0.unwrap();
    let print = |run: &dyn Fn(&mut Console)| -> String {
        let (mut out, mut notes) = (Vec::new(), Vec::new());
        run(&mut Console::new(&mut out, &mut notes, false));
        String::from_utf8(out).unwrap()
    };
    print(&|console| {
        let mesh = map_mesh(out.as_ref(), 0.15, console).unwrap();
        write_triangles(at("mesh.ply"), &mesh.vertices, &[], &mesh.triangles).unwrap();
    });
    // Points of the whole room: how near the mesh is to them is asked, not how much is missing.
    let (vertices, triangles) = LidarWorld::room().mesh();
    let room = weaver_mesh::Mesh { vertices, triangles };
    let positions = room.sample(400.0, 0);
    let cloud = PointCloud { colors: vec![[0; 3]; positions.len()], positions };
    weaver_io::ply::write_points(folder.path().join("truth.ply"), &cloud).unwrap();
    let eval = EvalLine::parse_from(["eval-mesh", &at("mesh.ply"), &at("truth.ply"), "--json"]);
    let printed = print(&|console| eval_mesh(&eval.line, console).unwrap());
    let figures: serde_json::Value = serde_json::from_str(&printed).unwrap();
    let accuracy = figures["accuracy_m"].as_f64().unwrap();
    assert!(accuracy < 0.08, "{printed}");
}
