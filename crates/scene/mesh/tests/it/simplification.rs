//! Fewer triangles, and edges of at most two.

use crate::solids::{ball, cube, open_edges, pinched, volume};
use proptest::prelude::*;
use weaver_geometry::glam::DVec3;
use weaver_mesh::Mesh;

#[test]
fn a_cube_needs_twelve_triangles() {
    let (mesh, colors) = cube(20, |p| p).simplified(&[], 12, |_| {});
    assert_eq!((mesh.triangles.len(), mesh.vertices.len(), colors.len()), (12, 8, 0));
    assert!(mesh.vertices.as_flattened().iter().all(|x| (x.abs() - 1.0).abs() < 1e-4), "{:?}", mesh.vertices);
    assert!((volume(&mesh) - 8.0).abs() < 1e-3 && open_edges(&mesh) == 0);
}

#[test]
fn a_tenth_of_a_ball_is_a_ball() {
    let ball = ball(30);
    let mut told = Vec::new();
    let (mesh, _) = ball.simplified(&[], ball.triangles.len() / 10, |left| told.push(left));
    assert_eq!((mesh.triangles.len(), open_edges(&mesh), pinched(&mesh)), (ball.triangles.len() / 10, 0, 0));
    let off = |p: &[f32; 3]| (DVec3::from_array(p.map(f64::from)).length() - 1.0).abs();
    let worst = mesh.vertices.iter().chain(&mesh.sample(500.0, 1)).map(off).fold(0.0, f64::max);
    assert!(worst < 0.01, "{worst}");
    // So many triangles with their corners on the ball lose 0.7 %.
    assert!((volume(&mesh) / volume(&ball) - 1.0).abs() < 5e-3, "{} of {}", volume(&mesh), volume(&ball));
    let outward = |t: &&[u32; 3]| {
        let [a, b, c] = mesh.corners(**t);
        (b - a).cross(c - a).normalize().dot((a + b + c).normalize()) > 0.8
    };
    assert_eq!(mesh.triangles.iter().filter(outward).count(), mesh.triangles.len());
}

/// The same at any number of threads, and as often as it is asked.
#[test]
fn simplifying_gives_the_same_bits_again() {
    let ball = ball(16);
    let colors: Vec<[u8; 3]> = ball.vertices.iter().map(|v| v.map(|x| (120.0 * x + 128.0) as u8)).collect();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| ball.simplified(&colors, 300, |_| {}))
    };
    assert!(on(1) == on(3) && on(1) == on(1));
}

/// A flat square keeps its outline, and the line between its two colors.
#[test]
fn borders_and_colors_stay_where_they_are() {
    let side = 32_u32;
    let count = side + 1;
    let vertices: Vec<[f32; 3]> = (0..count * count).map(|i| [(i % count) as f32, (i / count) as f32, 0.0]).collect();
    let quad = |i: u32| [[i, i + 1, i + count + 1], [i, i + count + 1, i + count]];
    let triangles = (0..side * count).filter(|i| i % count < side).flat_map(quad).collect();
    let square = Mesh { vertices, triangles };
    let colors: Vec<[u8; 3]> =
        square.vertices.iter().map(|v| if v[0] < 16.0 { [250, 10, 10] } else { [10, 10, 250] }).collect();
    let (mesh, colors) = square.simplified(&colors, 60, |_| {});
    assert!(mesh.triangles.len() <= 60 && (mesh.area() - 1024.0).abs() < 0.01, "{}", mesh.area());
    for (v, color) in mesh.vertices.iter().zip(&colors) {
        let expected = if v[0] < 15.0 { [250, 10, 10] } else { [10, 10, 250] };
        let near = color.iter().zip(expected).all(|(a, b): (&u8, u8)| a.abs_diff(b) < 40);
        assert!(near || (14.5..16.5).contains(&v[0]), "{color:?} at {v:?}");
    }
}

/// A mesh that no collapse can make smaller stays: a tetrahedron has four triangles.
#[test]
fn a_closed_surface_never_vanishes() {
    let (mesh, _) = ball(6).simplified(&[], 1, |_| {});
    assert!((4..20).contains(&mesh.triangles.len()) && open_edges(&mesh) == 0, "{}", mesh.triangles.len());
    assert_eq!(Mesh::default().simplified(&[], 1, |_| {}), (Mesh::default(), vec![]));
}

/// Two cubes that touch in an edge, and two in a vertex, become apart; each stays closed.
#[test]
fn solids_that_touch_come_apart() {
    let unit = cube(1, |p| p);
    for (shift, shared) in [([2.0, 2.0, 0.0], 2), ([2.0, 2.0, 2.0], 1)] {
        let mut both = unit.clone();
        let mut places: Vec<u32> = Vec::new();
        for v in &unit.vertices {
            let moved: [f32; 3] = std::array::from_fn(|k| v[k] + shift[k]);
            let known = both.vertices.iter().position(|p| *p == moved);
            places.push(known.unwrap_or_else(|| {
                both.vertices.push(moved);
                both.vertices.len() - 1
            }) as u32);
        }
        assert_eq!(both.vertices.len(), 16 - shared);
        both.triangles.extend(unit.triangles.iter().map(|t| t.map(|i| places[i as usize])));
        let apart = both.manifold();
        assert_eq!((open_edges(&apart), pinched(&apart)), (0, 0));
        assert!((volume(&apart) - 16.0).abs() < 1e-6 && (apart.area() - both.area()).abs() < 1e-6);
        assert_eq!(apart.largest_pieces(9, 1).largest_pieces(1, 1).triangles.len(), apart.triangles.len() / 2);
    }
    assert_eq!(unit.manifold().sample(9.0, 1), unit.sample(9.0, 1));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 8))]

    /// Bumpy balls stay closed, of one piece and of about their volume, whatever is left of them.
    #[test]
    fn a_bumpy_ball_stays_closed(seed in 0.0_f64..9.0, part in 3_usize..10) {
        let bumpy = cube(12, |p| p.normalize() * (1.0 + 0.1 * (5.0 * p.x + seed).sin() * (4.0 * p.y - seed).cos()));
        let (mesh, _) = bumpy.simplified(&[], bumpy.triangles.len() / part, |_| {});
        prop_assert!(mesh.triangles.len() <= bumpy.triangles.len() / part);
        prop_assert_eq!((open_edges(&mesh), pinched(&mesh)), (0, 0));
        prop_assert!((volume(&mesh) / volume(&bumpy) - 1.0).abs() < 0.03);
    }
}
