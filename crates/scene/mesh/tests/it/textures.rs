//! Pictures painted from photos: colors, seams, and parts that no photo sees.

use crate::solids::cube;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::trajectory::look_at;
use weaver_geometry::{Camera, Intrinsics};
use weaver_mesh::{Mesh, PhotoView, Texture};

/// The color of each side of a cube: minus and plus x, y, z.
const SIDES: [[u8; 3]; 6] =
    [[200, 40, 40], [40, 200, 40], [40, 40, 200], [200, 200, 40], [40, 200, 200], [200, 40, 200]];

fn camera(from: DVec3, width: usize) -> Camera {
    let half = width as f64 / 2.0;
    let intrinsics = Intrinsics { fx: 2.0 * half, fy: 2.0 * half, cx: half, cy: half };
    Camera { pose: look_at(from, DVec3::ZERO, DVec3::new(0.1, 0.2, 1.0)), intrinsics, width, height: width }
}

/// The side of the cube [-1, 1]^3 that a ray enters, and where.
fn entered(from: DVec3, ray: DVec3) -> Option<(usize, DVec3)> {
    (0..6).find_map(|i| {
        let (axis, side) = (i / 2, if i % 2 == 0 { -1.0 } else { 1.0 });
        let point = from + ray * ((side - from[axis]) / ray[axis]);
        let within = (0..3).all(|k| k == axis || point[k].abs() <= 1.0);
        (within && ray[axis] * side < 0.0).then_some((i, point))
    })
}

/// A photo of the cube by a function of sides and places, black beyond.
fn photo(camera: &Camera, color: impl Fn(usize, DVec3) -> [u8; 3]) -> Vec<u8> {
    let from = camera.pose.center();
    let pixel = |i: usize| {
        let at = DVec2::new((i % camera.width) as f64 + 0.5, (i / camera.width) as f64 + 0.5);
        let ray = camera.unproject(at, 1.0) - from;
        entered(from, ray).map_or([0; 3], |(side, point)| color(side, point))
    };
    (0..camera.width * camera.height).flat_map(pixel).collect()
}

fn views<'a>(cameras: &[Camera], photos: &'a [Vec<u8>]) -> Vec<PhotoView<'a>> {
    cameras.iter().zip(photos).map(|(camera, rgb)| PhotoView { camera: *camera, rgb, mask: None }).collect()
}

/// The color of a texture at the middle of each triangle.
fn middles(mesh: &Mesh, texture: &Texture) -> Vec<(DVec3, [u8; 3])> {
    let triangles = mesh.triangles.iter().zip(&texture.corners);
    let middle = |(triangle, corners): (&[u32; 3], &[u32; 3])| {
        let [a, b, c] = mesh.corners(*triangle);
        let at: DVec2 =
            corners.iter().map(|k| DVec2::from_array(texture.coordinates[*k as usize].map(f64::from))).sum();
        let [x, y] = (at / 3.0 * texture.size as f64).to_array().map(|x| x as usize);
        let first = 3 * (y * texture.size + x);
        ((a + b + c) / 3.0, [0, 1, 2].map(|k| texture.pixels[first + k]))
    };
    triangles.map(middle).collect()
}

fn far(a: [u8; 3], b: [u8; 3]) -> u8 {
    a.iter().zip(b).map(|(a, b)| a.abs_diff(b)).max().unwrap()
}

fn around() -> Vec<Camera> {
    let corners = (0..8).map(|i| [0, 1, 2].map(|k| if i >> k & 1 == 0 { -3.0 } else { 3.0 }));
    corners.map(|from| camera(DVec3::from_array(from), 256)).collect()
}

/// Every triangle of a cube gets the color of its side, whole, from its chart; the texture is the same at any number of
/// threads.
#[test]
fn a_painted_cube_has_the_colors_of_its_sides() {
    let mesh = cube(6, |p| p);
    let cameras = around();
    let photos: Vec<Vec<u8>> = cameras.iter().map(|camera| photo(camera, |side, _| SIDES[side])).collect();
    let views = views(&cameras, &photos);
    let texture = Texture::paint(&mesh, &views, 256, |_, _| {}).unwrap();
    for (i, (at, color)) in middles(&mesh, &texture).into_iter().enumerate() {
        let expected = SIDES[i / 72];
        assert!(far(color, expected) < 12, "{color:?} in place of {expected:?} at {at}");
    }
    assert!(texture.seen > 0.95, "{}", texture.seen);
    // Every place has its vertex, and charts take most of the picture.
    for (triangle, corners) in mesh.triangles.iter().zip(&texture.corners) {
        assert_eq!(corners.map(|k| texture.vertices[k as usize]), *triangle);
    }
    let flat = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|k| DVec2::from_array(texture.coordinates[k as usize].map(f64::from)));
        0.5 * (b - a).perp_dot(c - a)
    };
    // All turn alike, none is mirrored.
    let areas: Vec<f64> = texture.corners.iter().map(flat).collect();
    assert!(areas.iter().all(|area| area.signum() == areas[0].signum()));
    assert!(areas.iter().sum::<f64>().abs() > 0.5, "{}", areas.iter().sum::<f64>());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert!(pool.install(|| Texture::paint(&mesh, &views, 256, |_, _| {}).unwrap()) == texture);
}

/// Photos with exposures of 1 to 0.6 leave no step between neighboring triangles; without gains there would be one of
/// up to 60.
#[test]
fn exposures_leave_no_step() {
    let mesh = cube(16, |p| p);
    let cameras = around();
    let photos: Vec<Vec<u8>> = cameras
        .iter()
        .enumerate()
        .map(|(i, camera)| photo(camera, |_, _| [150, 120, 100].map(|x| (f64::from(x) * [1.0, 0.6, 0.8][i % 3]) as u8)))
        .collect();
    let texture = Texture::paint(&mesh, &views(&cameras, &photos), 512, |_, _| {}).unwrap();
    let colors: Vec<[u8; 3]> = middles(&mesh, &texture).into_iter().map(|(_, color)| color).collect();
    let spread = |k: usize| colors.iter().map(|c| c[k]).max().unwrap() - colors.iter().map(|c| c[k]).min().unwrap();
    assert!((0..3).all(|k| spread(k) <= 3), "{} {} {}", spread(0), spread(1), spread(2));
    // Neither the brightest nor the darkest.
    assert!((95..145).contains(&colors[0][0]), "{:?}", colors[0]);
}

/// Two photos whose colors differ by more than gains can undo go over into one another along a triangle and more, where
/// one of them ends.
#[test]
fn photos_go_over_into_one_another() {
    let mesh = cube(32, |p| p);
    let cameras = [camera(DVec3::new(3.0, 1.0, 0.5), 256), camera(DVec3::new(1.0, 3.0, 0.5), 256)];
    // Each gets darker toward one edge of the side that both see.
    let shade = |i: usize, p: DVec3| if i == 0 { 140.0 + 20.0 * p.z } else { 140.0 - 20.0 * p.z };
    let photos: Vec<Vec<u8>> =
        cameras.iter().enumerate().map(|(i, camera)| photo(camera, |_, p| [shade(i, p) as u8; 3])).collect();
    let texture = Texture::paint(&mesh, &views(&cameras, &photos), 1024, |_, _| {}).unwrap();
    let size = texture.size;
    let mut worst = 0;
    for (triangle, corners) in mesh.triangles.iter().zip(&texture.corners) {
        // Of the two sides that both see, without their borders, whose photos show the space beyond.
        let [a, b, c] = mesh.corners(*triangle);
        let at = (a + b + c) / 3.0;
        if at.x.max(at.y) < 0.99 || at.x.min(at.y).abs() > 0.9 || at.z.abs() > 0.9 {
            continue;
        }
        let at = corners.map(|k| DVec2::from_array(texture.coordinates[k as usize].map(f64::from)) * size as f64);
        let color = |p: DVec2| i32::from(texture.pixels[3 * (p.y as usize * size + p.x as usize)]);
        let middle = (at[0] + at[1] + at[2]) / 3.0;
        let steps: Vec<i32> = (0..8).map(|i| color(middle.lerp(at[0], 0.8 * f64::from(i) / 7.0))).collect();
        worst = steps.windows(2).map(|w| (w[0] - w[1]).abs()).max().unwrap().max(worst);
    }
    // The photos differ by up to 36 there.
    assert!((2..=10).contains(&worst), "{worst}");
}

/// The back of a cube that only its front was photographed of takes the colors beside it; so does the space between
/// charts, at any coarser level.
#[test]
fn what_no_photo_sees_is_filled() {
    let mesh = cube(8, |p| p);
    let cameras = [camera(DVec3::new(3.0, 2.0, 2.0), 256)];
    let photos = [photo(&cameras[0], |_, _| [90, 150, 210])];
    let texture = Texture::paint(&mesh, &views(&cameras, &photos), 256, |_, _| {}).unwrap();
    assert!((0.3..0.7).contains(&texture.seen), "{}", texture.seen);
    let off = texture.pixels.chunks_exact(3).map(|p| far([p[0], p[1], p[2]], [90, 150, 210])).max().unwrap();
    assert!(off < 6, "{off}");
    // Nothing at all was seen: gray.
    let masked = [false].repeat(256 * 256);
    let view = PhotoView { mask: Some(&masked), ..views(&cameras, &photos)[0] };
    let texture = Texture::paint(&mesh, &[view], 64, |_, _| {}).unwrap();
    assert!(texture.seen == 0.0 && texture.pixels.iter().all(|x| *x == 128));
}

/// A wall in front of another hides it, and does not leave its color on it.
#[test]
fn what_stands_behind_takes_no_color() {
    let mut mesh = cube(8, |p| p * DVec3::new(4.0, 4.0, 0.1));
    let first = mesh.vertices.len() as u32;
    let front = cube(4, |p| DVec3::new(p.x, p.y, 0.1 * p.z + 2.0));
    mesh.vertices.extend(&front.vertices);
    mesh.triangles.extend(front.triangles.iter().map(|t| t.map(|i| i + first)));
    let cameras = [camera(DVec3::new(0.0, 0.0, 9.0), 256), camera(DVec3::new(4.0, 0.0, 8.0), 256)];
    let photos: Vec<Vec<u8>> = cameras
        .iter()
        .map(|camera| {
            let from = camera.pose.center();
            let pixel = |i: usize| {
                let at = DVec2::new((i % 256) as f64 + 0.5, (i / 256) as f64 + 0.5);
                let ray = camera.unproject(at, 1.0) - from;
                let hit = from + ray * ((2.1 - from.z) / ray.z);
                if hit.x.abs() < 1.0 && hit.y.abs() < 1.0 { [220, 30, 30] } else { [30, 30, 220] }
            };
            (0..256 * 256).flat_map(pixel).collect()
        })
        .collect();
    let texture = Texture::paint(&mesh, &views(&cameras, &photos), 512, |_, _| {}).unwrap();
    let upper = middles(&mesh, &texture).into_iter().filter(|(at, _)| at.z > 0.05 && at.z < 0.2);
    for (at, color) in upper {
        assert!(color[2] > 120 && color[0] < 120, "{color:?} at {at}");
    }
}

#[test]
fn textures_that_make_no_sense_are_refused() {
    let mesh = cube(4, |p| p);
    let cameras = [camera(DVec3::new(3.0, 2.0, 2.0), 16)];
    let rgb = vec![0; 12];
    let error = |size: usize| {
        Texture::paint(&mesh, &views(&cameras, std::slice::from_ref(&rgb)), size, |_, _| {}).unwrap_err().to_string()
    };
    assert_eq!(error(64), "photo 0: expected 256 pixels, and no mask or as large a one, found 4 and 256");
    assert_eq!(error(1), "texture: expected a side of 16 to 16384 texels, found 1");
    let apart = Mesh {
        vertices: (0..300).map(|i| [i as f32, (i % 3) as f32, (i % 2) as f32]).collect(),
        triangles: (0..100).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
    };
    let error = Texture::paint(&apart, &[], 16, |_, _| {}).unwrap_err().to_string();
    assert!(error.starts_with("texture: expected room for 100 charts, found 16 x 16 texels"), "{error}");
    let nothing = Texture::paint(&Mesh::default(), &[], 16, |_, _| {}).unwrap();
    assert!(nothing.pixels.len() == 768 && nothing.corners.is_empty());
}
