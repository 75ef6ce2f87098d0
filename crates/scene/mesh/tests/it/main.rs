//! Integration tests.

mod drawn;
mod scenes;
mod simplification;
mod solids;
mod textures;

use proptest::prelude::*;
use weaver_geometry::Pose;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_mesh::{
    Benchmark, DistanceField, FAR, FieldProgress, Mesh, MeshError, RangeView, compare, mesh_chamfer, point_chamfer,
    spread, thinned,
};
use weaver_surfel::SurfelCamera;

/// The range to the sides of a cube around the origin, and their normals.
fn cube(camera: &SurfelCamera, pose: &Pose, half: f64) -> (Vec<f32>, Vec<f32>) {
    let (mut ranges, mut normals) = (Vec::new(), Vec::new());
    let to_world = pose.inverse();
    for i in 0..camera.pixels() {
        let d = to_world.rotation * camera.pixel_ray(i % camera.width, i / camera.width);
        let from = to_world.translation;
        let to = |axis: usize| (half * d[axis].signum() - from[axis]) / d[axis];
        let axis = (0..3).min_by(|a, b| to(*a).total_cmp(&to(*b))).unwrap();
        ranges.push(to(axis) as f32);
        let normal = pose.rotation * (-DVec3::AXES[axis] * d[axis].signum());
        normals.extend(normal.to_array().map(|x| x as f32));
    }
    (ranges, normals)
}

fn views() -> Vec<Pose> {
    [DVec3::ZERO, DVec3::new(0.4, -0.3, 0.2), DVec3::new(-0.5, 0.2, -0.1)]
        .into_iter()
        .enumerate()
        .map(|(i, at)| Pose::new(DMat3::from_rotation_z(i as f64), at).inverse())
        .collect()
}

fn meshed(voxel: f64) -> Mesh {
    let camera = SurfelCamera::spherical([512, 256], [-1.57, 1.57]);
    let images: Vec<_> = views().iter().map(|pose| cube(&camera, pose, 1.5)).collect();
    let views: Vec<RangeView<'_>> = views()
        .into_iter()
        .zip(&images)
        .map(|(pose, (range, normal))| RangeView { camera: &camera, pose, range, normal })
        .collect();
    DistanceField::new(&views, voxel, 3.0 * voxel).unwrap().mesh()
}

#[test]
fn a_cube_is_closed_and_faces_the_cameras() {
    let mesh = meshed(0.07);
    let away = |v: &[f32; 3]| (v.iter().fold(0.0_f32, |a, x| a.max(x.abs())) - 1.5).abs();
    let worst = mesh.vertices.iter().map(away).fold(0.0, f32::max);
    assert!(worst < 0.05, "{worst}");
    assert!((mesh.area() - 54.0).abs() < 1.5, "{}", mesh.area());
    // Every edge is in two triangles, once in each direction.
    let mut edges: Vec<(u32, u32)> =
        mesh.triangles.iter().flat_map(|t| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])]).collect();
    edges.sort_unstable();
    let open = edges.iter().filter(|(a, b)| edges.binary_search(&(*b, *a)).is_err()).count();
    assert!(open * 100 < edges.len(), "{open} of {}", edges.len());
    let inward = mesh.triangles.iter().filter(|t| {
        let [a, b, c] = mesh.corners(**t);
        (b - a).cross(c - a).dot(a) < 0.0
    });
    assert!(inward.count() * 100 > mesh.triangles.len() * 99);
}

#[test]
fn a_sampled_mesh_is_near_what_was_seen() {
    let mesh = meshed(0.05);
    let points = mesh.sample(400.0, 1);
    assert!((points.len() as f64 - 400.0 * mesh.area()).abs() < 2.0);
    let mut exact = Vec::new();
    for i in -14..15 {
        for k in -14..15 {
            let (a, b) = (0.1 * i as f32, 0.1 * k as f32);
            exact.extend([-1.5, 1.5].into_iter().flat_map(|s| [[a, b, s], [a, s, b], [s, a, b]]));
        }
    }
    let errors = compare(&points, &exact, 0.1).unwrap();
    assert!(errors.completeness < 0.05 && errors.f_score > 0.99, "{errors:?}");
}

#[test]
fn what_makes_no_sense_is_refused() {
    let camera = SurfelCamera::spherical([16, 8], [-0.5, 0.5]);
    let view = RangeView { camera: &camera, pose: Pose::IDENTITY, range: &[1.0], normal: &[] };
    let error = DistanceField::new(&[view], 0.1, 0.3).unwrap_err();
    assert_eq!(error.to_string(), "view 0: expected 128 ranges, and no or as many normals, found 1 and 0");
    assert_eq!(DistanceField::new(&[], 0.0, 0.3).unwrap_err(), MeshError::Size { what: "cells", found: 0.0 });
    let empty = DistanceField::new(&[], 0.1, 0.3).unwrap();
    assert_eq!((empty.blocks(), empty.mesh()), (0, Mesh::default()));
}

/// Nothing is near nothing: without points there are no errors, and without a point that is near no accuracy and no
/// Chamfer distance. Nor is a mesh without triangles judged as a surface, or one whose corners are nowhere.
///
/// Promise of `nothing_is_no_good_mesh`.
#[test]
fn what_is_not_there_has_no_good_score() {
    let plane = |z: f32| (0..100).map(|i| [i as f32 % 10.0, (i / 10) as f32, z]).collect::<Vec<_>>();
    assert_eq!((compare(&[], &plane(0.0), 0.2), compare(&plane(0.0), &[], 0.2)), (None, None));
    let far = compare(&plane(10.0), &plane(0.0), 0.2).unwrap();
    assert_eq!((far.accuracy, far.chamfer, far.beyond, far.completeness), (None, None, 1.0, FAR));
    let both = compare(&[plane(10.0), plane(0.1)].concat(), &plane(0.0), 0.2).unwrap();
    assert!((both.accuracy.unwrap() - 0.1).abs() < 1e-6 && both.beyond == 0.5, "{both:?}");
    let bare = Mesh { vertices: plane(0.016), triangles: vec![] };
    assert_eq!(mesh_chamfer(&bare, &plane(0.0), &Benchmark::DTU, 0), None);
    for nowhere in [f32::NAN, f32::INFINITY] {
        let vertices = vec![[0.0; 3], [nowhere; 3], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]];
        let mesh = Mesh { vertices, triangles: vec![[0, 1, 2], [0, 2, 3]] };
        let points = mesh.sample(50.0, 0);
        assert!(points.len() == 100 && points.as_flattened().iter().all(|x| x.is_finite()), "{}", points.len());
    }
}

/// The bytes of a field are reported, view by view, before they are taken, the observer may end it, and cells too small
/// to be numbered are refused at the first view. The field is the same.
///
/// Promise (fits): a mesh's memory is asked for before it is taken, and its making is seen.
#[test]
fn a_field_tells_its_size_before_it_is_made() {
    let camera = SurfelCamera::spherical([64, 32], [-1.57, 1.57]);
    let images: Vec<_> = views().iter().map(|pose| cube(&camera, pose, 1.5)).collect();
    let views: Vec<RangeView<'_>> = views()
        .into_iter()
        .zip(&images)
        .map(|(pose, (range, normal))| RangeView { camera: &camera, pose, range, normal })
        .collect();
    let mut seen: Vec<FieldProgress> = Vec::new();
    let field = DistanceField::watched(&views, 0.1, 0.3, |part| {
        seen.push(part);
        Ok::<(), MeshError>(())
    });
    let field = field.unwrap();
    let told: Vec<u64> = seen.iter().map(|part| part.bytes).collect();
    assert!(told[0] > 4096 && told.is_sorted() && told[views.len() - 1] == *told.last().unwrap(), "{told:?}");
    assert!(told[views.len() - 1] > 4096 * field.blocks() as u64, "{told:?}");
    assert!(seen.iter().enumerate().all(|(i, part)| part.done == i + 1 && part.done <= part.of), "{seen:?}");
    assert_eq!(field.mesh(), DistanceField::new(&views, 0.1, 0.3).unwrap().mesh());
    let enough = MeshError::Size { what: "memory", found: 0.0 };
    let ended = DistanceField::watched(&views, 0.1, 0.3, |part| match part.done {
        1 => Ok(()),
        _ => Err(enough.clone()),
    });
    assert_eq!(ended.unwrap_err(), enough);
    assert_eq!(DistanceField::new(&views[..1], 1e-10, 3e-10).unwrap_err(), MeshError::TooMany { voxel: 1e-10 });
}

proptest! {
    #[test]
    fn thinned_points_are_one_in_each_cube(points in proptest::collection::vec(proptest::array::uniform3(-2.0_f32..2.0), 0..200)) {
        let kept = thinned(&points, 0.5);
        let mut cubes: Vec<[i32; 3]> = kept.iter().map(|p| p.map(|x| (x / 0.5).floor() as i32)).collect();
        cubes.sort_unstable();
        let count = cubes.len();
        cubes.dedup();
        prop_assert_eq!(cubes.len(), count);
        prop_assert_eq!(&thinned(&kept, 0.5), &kept);
    }

    #[test]
    fn errors_are_those_of_all_pairs(
        a in proptest::collection::vec(proptest::array::uniform3(-1.0_f32..1.0), 1..40),
        b in proptest::collection::vec(proptest::array::uniform3(-1.0_f32..1.0), 1..40),
    ) {
        let nearest = |p: &[f32; 3], to: &[[f32; 3]]| {
            to.iter().map(|q| (0..3).map(|i| (p[i] - q[i]).powi(2)).sum::<f32>().sqrt()).fold(f32::INFINITY, f32::min)
        };
        let expected = b.iter().map(|p| f64::from(nearest(p, &a)).min(0.5)).sum::<f64>() / b.len() as f64;
        prop_assert!((compare(&a, &b, 0.2).unwrap().completeness - expected).abs() < 1e-6);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]

    /// No two points that stay are nearer than the spacing, each that goes has one that near, and the same seed keeps
    /// the same.
    ///
    /// Promise of `meshes_are_measured_as_benchmarks_do`.
    #[test]
    fn points_are_spread(points in proptest::collection::vec([-3.0_f32..3.0, -3.0..3.0, -3.0..3.0], 1..300), spacing in 0.2_f64..2.0) {
        let kept = spread(&points, spacing, 3);
        let apart = |a: &[f32; 3], b: &[f32; 3]| a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt();
        for (i, a) in kept.iter().enumerate() {
            prop_assert!(kept[..i].iter().all(|b| apart(a, b) >= spacing));
        }
        prop_assert!(points.iter().all(|p| kept.iter().any(|k| apart(p, k) < spacing)));
        prop_assert_eq!(&kept, &spread(&points, spacing, 3));
    }

    /// A cloud that moved by a millimeter is a millimeter off, both ways, wherever it lies.
    ///
    /// Promise of `meshes_are_measured_as_benchmarks_do`.
    #[test]
    fn a_moved_cloud_is_as_far_off(shift in -40.0_f32..40.0) {
        let plane = |z: f32| (0..400).map(|i| [(i % 20) as f32 + shift, (i / 20) as f32, z]).collect::<Vec<_>>();
        let found = point_chamfer(&plane(1.0), &plane(0.0), &Benchmark::DTU).unwrap();
        prop_assert!((found.accuracy - 1.0).abs() < 1e-5 && (found.completeness - 1.0).abs() < 1e-5, "{found:?}");
    }
}
