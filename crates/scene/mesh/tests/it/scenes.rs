//! Meshes of scenes of Gaussians, and their pieces.

use weaver_geometry::glam::DVec3;
use weaver_geometry::trajectory::orbit;
use weaver_geometry::{Camera, Intrinsics, sh};
use weaver_mesh::{DistanceField, DrawnScene, Mesh};
use weaver_scene::Gaussians;
use weaver_splat::RasterSettings;

/// Small opaque Gaussians all over a ball, red above and green below, and a wall far behind.
fn ball(radius: f64) -> Gaussians {
    let mut scene = Gaussians::default();
    let mut add = |at: DVec3, color: [f64; 3]| {
        scene.means.push(at.to_array().map(|x| x as f32));
        scene.quats.push([1.0, 0.0, 0.0, 0.0]);
        scene.log_scales.push([0.02_f32.ln(); 3]);
        scene.opacity_logits.push(6.0);
        scene.sh.extend(color.map(|c| ((c - 0.5) / sh::DC) as f32));
    };
    let count = 8000;
    for i in 0..count {
        // A spiral from pole to pole has equal areas.
        let z = 1.0 - (2 * i + 1) as f64 / count as f64;
        let (sin, cos) = (i as f64 * 2.399_963).sin_cos();
        let around = (1.0 - z * z).sqrt();
        let color = if z > 0.0 { [0.9, 0.1, 0.1] } else { [0.1, 0.7, 0.1] };
        add(DVec3::new(around * cos, around * sin, z) * radius, color);
    }
    for i in 0..400 {
        add(DVec3::new((i % 20) as f64 - 10.0, 40.0, (i / 20) as f64 - 10.0), [0.0, 0.0, 1.0]);
    }
    scene
}

fn cameras() -> Vec<Camera> {
    let intrinsics = Intrinsics { fx: 100.0, fy: 100.0, cx: 48.0, cy: 48.0 };
    let high = [-2.5, 0.0, 2.5];
    let poses = high.into_iter().flat_map(|z| orbit(DVec3::new(3.0, 0.0, z), DVec3::ZERO, DVec3::Z, 6));
    poses.map(|pose| Camera { pose, intrinsics, width: 96, height: 96 }).collect()
}

/// The mesh of a scene lies on its surface, is closed where cameras see it, has its colors, and ends at the
/// distance that was given.
#[test]
fn a_ball_of_gaussians_becomes_a_ball() {
    let mut scene = DrawnScene::new(&ball(1.0), [0.2, 0.4, 0.9], RasterSettings::default(), 6.0).carving();
    cameras().iter().for_each(|camera| scene.add(camera).unwrap());
    let mesh = DistanceField::new(&scene.views(), 0.05, 0.25).unwrap().mesh();
    let radii: Vec<f64> = mesh.vertices.iter().map(|v| DVec3::from_array(v.map(f64::from)).length()).collect();
    // Blended centers lie before the shell, by two deviations at most, and rims by another; then two cells.
    let off = radii.iter().map(|r| (r - 1.0).abs()).fold(0.0, f64::max);
    assert!(mesh.triangles.len() > 4000 && off < 3.0 * 0.02 + 2.0 * 0.05, "{off}");
    let mean = radii.iter().sum::<f64>() / radii.len() as f64;
    assert!((mean - 1.0).abs() < 0.04, "{mean}");
    let colors = scene.colors(&mesh.vertices, 0.25);
    for (vertex, color) in mesh.vertices.iter().zip(&colors).filter(|(v, _)| v[2].abs() > 0.2) {
        assert!((color[0] > 150) == (vertex[2] > 0.0) && color[2] < 100, "{color:?} at {vertex:?}");
    }
    assert_eq!(scene.colors(&[[9.0; 3]], 0.1), [[128; 3]]);
}

#[test]
fn the_largest_pieces_stay() {
    // Strips of 3, 1, 2 and 2 triangles, taken apart by their vertices.
    let mut mesh = Mesh::default();
    for count in [3, 1, 2, 2] {
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend((0..count + 2).map(|i| [i as f32, (i % 2) as f32, first as f32]));
        mesh.triangles.extend((0..count as u32).map(|i| [first + i + 2, first + i + 1, first + i]));
    }
    let sizes = |most: usize, least: usize| {
        let kept = mesh.largest_pieces(most, least);
        (kept.triangles.len(), kept.vertices.len(), kept.area())
    };
    assert_eq!(sizes(9, 1), (8, 16, mesh.area()));
    assert_eq!(sizes(9, 2), (7, 13, mesh.area() - 1.0));
    assert_eq!(sizes(1, 1), (3, 5, 3.0));
    assert_eq!((sizes(2, 1).0, sizes(9, 4), sizes(0, 0)), (5, (0, 0, 0.0), (0, 0, 0.0)));
    // Of equal ones the first.
    assert_eq!(mesh.largest_pieces(2, 2).vertices[5][2], mesh.vertices[8][2]);
}
