//! Exact range images of boxes, and the surfaces that come of them.

use crate::solids::{cube, open_edges, pinched, volume};
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::trajectory::{look_at, orbit};
use weaver_geometry::{Intrinsics, Pose};
use weaver_mesh::{DistanceField, Mesh, RangeView, compare};
use weaver_surfel::{Lens, SurfelCamera};

const CELL: f64 = 0.025;

/// Boxes by their least and largest corners.
type Boxes = Vec<[DVec3; 2]>;

/// Ground, a block on it, and a wall of two cells.
fn scene() -> Boxes {
    let thick = CELL;
    vec![
        [DVec3::new(-1.5, -1.5, -2.0), DVec3::new(1.5, 1.5, 0.0)],
        [DVec3::new(-0.8, -0.5, 0.0), DVec3::new(-0.2, 0.1, 0.5)],
        [DVec3::new(0.3, -0.7, 0.0), DVec3::new(0.3 + 2.0 * thick, 0.7, 0.8)],
    ]
}

/// The distance along a ray to the first box, infinite if there is none, and the normal there.
fn hit(boxes: &Boxes, from: DVec3, ray: DVec3) -> (f64, DVec3) {
    let mut first = (f64::INFINITY, DVec3::ZERO);
    for [low, high] in boxes {
        let (mut enter, mut leave, mut normal) = (0.0, f64::INFINITY, DVec3::ZERO);
        for k in 0..3 {
            let (a, b) = ((low[k] - from[k]) / ray[k], (high[k] - from[k]) / ray[k]);
            if a.min(b) > enter {
                (enter, normal) = (a.min(b), -DVec3::AXES[k] * ray[k].signum());
            }
            leave = a.max(b).min(leave);
        }
        if enter > 0.0 && enter < leave && enter < first.0 {
            first = (enter, normal);
        }
    }
    first
}

fn lens() -> SurfelCamera {
    let intrinsics = Intrinsics { fx: 150.0, fy: 150.0, cx: 100.0, cy: 75.0 };
    SurfelCamera { lens: Lens::Pinhole(intrinsics), width: 200, height: 150 }
}

fn poses() -> Vec<Pose> {
    let low = orbit(DVec3::new(3.0, 0.2, 0.8), DVec3::new(0.0, 0.0, 0.2), DVec3::Z, 14);
    let high = orbit(DVec3::new(1.6, 0.1, 2.4), DVec3::new(0.0, 0.0, 0.2), DVec3::Z, 8);
    low.into_iter().chain(high).collect()
}

/// Ranges that a few cameras see of boxes.
fn ranges(boxes: &Boxes, poses: &[Pose]) -> Vec<Vec<f32>> {
    let camera = lens();
    let view = |pose: &Pose| {
        let to_world = pose.inverse();
        let pixel = |i: usize| {
            let ray = to_world.rotation * camera.pixel_ray(i % camera.width, i / camera.width);
            hit(boxes, to_world.translation, ray).0 as f32
        };
        (0..camera.pixels()).map(pixel).collect()
    };
    poses.iter().map(view).collect()
}

fn field(boxes: &Boxes, poses: &[Pose], closed: bool) -> DistanceField {
    let (camera, images) = (lens(), ranges(boxes, poses));
    let view = |(pose, range): (&Pose, _)| RangeView { camera: &camera, pose: *pose, range, normal: &[] };
    let views: Vec<RangeView<'_>> = poses.iter().zip(images.iter().map(Vec::as_slice)).map(view).collect();
    let field = DistanceField::new(&views, CELL, 5.0 * CELL).unwrap();
    if closed { field.closed(&views).unwrap() } else { field }
}

/// Points on the boxes.
fn truth(boxes: &Boxes) -> Vec<[f32; 3]> {
    let surface = |[low, high]: &[DVec3; 2]| cube(1, |p| (*low + *high) / 2.0 + p * (*high - *low) / 2.0);
    boxes.iter().flat_map(|corners| surface(corners).sample(2500.0, 1)).collect()
}

/// Points of the boxes that at least two cameras see.
fn seen(boxes: &Boxes, poses: &[Pose]) -> Vec<[f32; 3]> {
    let camera = lens();
    let mut points = truth(boxes);
    points.retain(|point| {
        let p = DVec3::from_array(point.map(f64::from));
        let sees = |pose: &&Pose| {
            let (from, at) = (pose.center(), camera.project(pose.apply(p)));
            let inside = at.cmpge(DVec2::ZERO).all() && at.x < camera.width as f64 && at.y < camera.height as f64;
            let (reach, normal) = hit(boxes, from, (p - from).normalize());
            inside && (reach - p.distance(from)).abs() < 1e-4 && normal.dot((from - p).normalize()) > 0.15
        };
        poses.iter().filter(sees).count() >= 2
    });
    points
}

/// Shares of the surface within 1 % of the scene's size of the truth, and of the truth within that of the surface.
fn shares(mesh: &Mesh, boxes: &Boxes, poses: &[Pose]) -> (f64, f64) {
    let points = mesh.sample(2500.0, 2);
    let found = |truth: &[[f32; 3]]| compare(&points, truth, 0.03).unwrap();
    (found(&truth(boxes)).precision, found(&seen(boxes, poses)).recall)
}

/// Surfaces are accurate and complete at 1 % of the scene, also of a wall two cells thick, and after nine of ten
/// triangles went.
#[test]
fn walls_and_ground_are_where_they_are() {
    let (boxes, poses) = (scene(), poses());
    let mesh = field(&boxes, &poses, false).mesh().largest_pieces(50, 50).manifold();
    let (accuracy, completeness) = shares(&mesh, &boxes, &poses);
    let (few, _) = mesh.simplified(&[], mesh.triangles.len() / 10, |_| {});
    let (accuracy_of_few, completeness_of_few) = shares(&few, &boxes, &poses);
    let said = format!(
        "{} {accuracy:.4} {completeness:.4}, {} {accuracy_of_few:.4} {completeness_of_few:.4}",
        mesh.triangles.len(),
        few.triangles.len()
    );
    // The wall alone: its two sides, which lie two cells apart.
    let side = |x: f64| {
        let near = mesh
            .vertices
            .iter()
            .filter(|v| v[2] > 0.1 && v[2] < 0.7 && v[1].abs() < 0.6 && (f64::from(v[0]) - x).abs() < 0.2);
        let off: Vec<f64> =
            near.map(|v| (f64::from(v[0]) - x).abs().min((f64::from(v[0]) - x - 2.0 * CELL).abs())).collect();
        off.iter().sum::<f64>() / off.len() as f64
    };
    assert!(accuracy > 0.99 && completeness > 0.98, "{said}");
    assert!(accuracy_of_few > 0.99 && completeness_of_few > 0.98, "{said}");
    assert!(side(0.3) < 0.4 * CELL, "{}", side(0.3) / CELL);
}

/// Closed: every edge has two triangles, also at the ground's back, which nothing saw; seen parts are as
/// before.
#[test]
fn a_closed_field_has_a_closed_surface() {
    let (boxes, poses) = (scene(), poses());
    let mesh = field(&boxes, &poses, true).mesh().manifold().largest_pieces(50, 50);
    assert_eq!((open_edges(&mesh), pinched(&mesh)), (0, 0));
    assert!(volume(&mesh) > 0.5, "{}", volume(&mesh));
    let (_, completeness) = shares(&mesh, &boxes, &poses);
    assert!(completeness > 0.98, "{completeness}");
    let (few, _) = mesh.simplified(&[], mesh.triangles.len() / 10, |_| {});
    assert_eq!((open_edges(&few), pinched(&few)), (0, 0));
}

/// An open plane that one side was seen of becomes a slab, the same at any number of threads; nothing stays nothing.
#[test]
fn an_open_plane_becomes_a_slab() {
    let plane = vec![[DVec3::new(-0.5, -0.5, -1e-6), DVec3::new(0.5, 0.5, 0.0)]];
    let poses = [look_at(DVec3::new(0.3, 0.2, 1.5), DVec3::ZERO, DVec3::Y)];
    let open = field(&plane, &poses, false).mesh();
    let mesh = field(&plane, &poses, true).mesh().manifold();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert!(pool.install(|| field(&plane, &poses, true).mesh().manifold()) == mesh);
    assert!(open_edges(&open) > 50);
    assert_eq!((open_edges(&mesh), pinched(&mesh)), (0, 0));
    assert!(mesh.area() > 1.9 * open.area(), "{} {}", mesh.area(), open.area());
    assert_eq!(DistanceField::default().closed(&[]).unwrap().mesh(), Mesh::default());
}
