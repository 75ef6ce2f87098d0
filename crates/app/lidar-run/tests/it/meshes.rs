//! Meshes of runs.

use crate::commands::{SMALL, command, scans, text};
use clap::Parser;
use weaver_command::{Console, Failure};
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

/// A square that a scan shows one millimeter lower, and what is far from it, which is no error of it; a mesh in another unit is refused by name.
#[test]
fn meshes_are_measured_as_benchmarks_do() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(folder.path().join(name));
    let square = |side: f32, z: f32| weaver_mesh::Mesh {
        vertices: vec![[0.0, 0.0, z], [side, 0.0, z], [0.0, side, z], [side, side, z]],
        triangles: vec![[0, 1, 2], [1, 3, 2]],
    };
    let positions = square(20.0, 0.0).sample(100.0, 1);
    let cloud = PointCloud { colors: vec![[0; 3]; positions.len()], positions };
    weaver_io::ply::write_points(folder.path().join("scan.ply"), &cloud).unwrap();
    let run = |mesh: &weaver_mesh::Mesh, benchmark: &str| {
        write_triangles(at("mesh.ply"), &mesh.vertices, &[], &mesh.triangles).unwrap();
        let words = ["eval-mesh", &at("mesh.ply"), &at("scan.ply"), "--benchmark", benchmark, "--json"];
        let (mut out, mut notes) = (Vec::new(), Vec::new());
        let done = eval_mesh(&EvalLine::parse_from(words).line, &mut Console::new(&mut out, &mut notes, false));
        done.map(|()| serde_json::from_slice::<serde_json::Value>(&out).unwrap()).map_err(|failure| match failure {
            Failure::Error(error) => error.to_string(),
            other => format!("{other:?}"),
        })
    };
    let mut mesh = square(20.0, 1.0);
    let near = |figures: &serde_json::Value, key: &str| (figures[key].as_f64().unwrap() - 1.0).abs();
    for (key, most) in [("accuracy", 0.02), ("completeness", 0.02), ("chamfer", 0.02)] {
        assert!(near(&run(&mesh, "dtu").unwrap(), key) < most, "{key}");
    }
    // A second square 25 mm above is beyond what counts, one a meter off outside the box.
    for z in [25.0, 1000.0] {
        let more = square(20.0, z);
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend(&more.vertices);
        mesh.triangles.extend(more.triangles.iter().map(|t| t.map(|i| i + first)));
    }
    let figures = run(&mesh, "dtu").unwrap();
    assert!(near(&figures, "accuracy") < 0.02, "{figures}");
    // By points, distances above 20 count as 20: of twelve vertices eight are far.
    let points = run(&mesh, "points").unwrap();
    assert!((points["accuracy"].as_f64().unwrap() - (4.0 + 8.0 * 20.0) / 12.0).abs() < 0.05, "{points}");
    let error = run(&square(20.0, 500.0), "dtu").unwrap_err();
    assert!(error.contains("mesh.ply") && error.contains("none within 20"), "{error}");
}
