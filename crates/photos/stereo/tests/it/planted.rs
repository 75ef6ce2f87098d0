//! A planted wall, and photos of it.

use weaver_geometry::glam::{DMat3, DVec2, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_kernels::random::Stream;
use weaver_scene::{Photo, PointCloud};

/// The wall: `NORMAL . x = 1`.
pub const NORMAL: DVec3 = DVec3::new(0.08, 0.02, 0.2);

/// Photos, points of the wall, and which each photo sees.
pub struct Planted {
    pub photos: Vec<Photo>,
    pub points: PointCloud,
    pub visible: Vec<Vec<u32>>,
}

/// Photos of the wall from places side by side, and some of its points.
pub fn wall(photos: usize) -> Planted {
    let cameras: Vec<Camera> = (0..photos).map(|n| camera(n, photos)).collect();
    let stream = Stream::new(3, 0, "planted wall");
    let mut points = PointCloud::default();
    for n in 0..300 {
        let at = [2 * n, 2 * n + 1].map(|i| 5.0 * stream.uniform::<f64>(i) - 2.5);
        let z = (1.0 - NORMAL.x * at[0] - NORMAL.y * at[1]) / NORMAL.z;
        points.positions.push([at[0], at[1], z].map(|x| x as f32));
        points.colors.push([128; 3]);
    }
    let sees = |camera: &Camera, point: &[f32; 3]| {
        let at = camera.intrinsics.project(camera.pose.apply(DVec3::from(point.map(f64::from))));
        at.x >= 0.0 && at.y >= 0.0 && at.x < camera.width as f64 && at.y < camera.height as f64
    };
    let seen = |camera: &Camera| {
        (0..).zip(&points.positions).filter(|(_, point)| sees(camera, point)).map(|(n, _)| n).collect()
    };
    let visible = cameras.iter().map(seen).collect();
    let photos = cameras.into_iter().enumerate().map(|(n, camera)| taken(n, camera)).collect();
    Planted { photos, points, visible }
}

fn camera(n: usize, of: usize) -> Camera {
    let x = n as f64 - 0.5 * (of - 1) as f64;
    let intrinsics = Intrinsics { fx: 90.0, fy: 90.0, cx: 48.0, cy: 36.0 };
    let rotation = DMat3::from_rotation_y(0.12 * x) * DMat3::from_rotation_z(0.05 * x);
    let pose = Pose::new(rotation, -(rotation * DVec3::new(0.7 * x, 0.1 * x, 0.0)));
    Camera { pose, intrinsics, width: 96, height: 72 }
}

/// Inverse depth of the wall at a pixel, in the camera's frame.
pub fn inverse_depth(camera: &Camera, pixel: DVec2) -> f64 {
    // NORMAL . (R' (ray z - t)) = 1, for z.
    let normal = camera.pose.rotation * NORMAL;
    let ray = camera.intrinsics.unproject(pixel, 1.0);
    normal.dot(ray) / (1.0 + normal.dot(camera.pose.translation))
}

fn taken(n: usize, camera: Camera) -> Photo {
    let back = camera.pose.inverse();
    let pixels = (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (x, y)));
    let color = |(x, y): (usize, usize)| {
        let mut sum = 0.0;
        // Four rays for each pixel.
        for [dx, dy] in [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]] {
            let pixel = DVec2::new(x as f64 + dx, y as f64 + dy);
            let point = back.apply(camera.intrinsics.unproject(pixel, 1.0 / inverse_depth(&camera, pixel)));
            sum += 0.25 * texture(point.x, point.y);
        }
        [(255.0 * sum) as u8; 3]
    };
    Photo { name: format!("{n}.png"), camera, rgb: pixels.flat_map(color).collect(), mask: None, lens: None }
}

/// Smooth noise in cells of a quarter and of a whole.
fn texture(x: f64, y: f64) -> f64 {
    let noise = |x: f64, y: f64, purpose| {
        let (ix, iy) = (x.floor(), y.floor());
        let (fx, fy) = (x - ix, y - iy);
        let at = |dx: i64, dy: i64| {
            let cell = (ix as i64 + dx + 1000) as u64 * 5000 + (iy as i64 + dy + 1000) as u64;
            Stream::new(5, 0, purpose).uniform::<f64>(cell)
        };
        let row = |dy| at(0, dy) * (1.0 - fx) + at(1, dy) * fx;
        row(0) * (1.0 - fy) + row(1) * fy
    };
    0.6 * noise(4.0 * x, 4.0 * y, "fine") + 0.4 * noise(x, y, "coarse")
}
