//! Photos that are drawn through their own lens.

use crate::scenes::{cloud, finish, plain};
use weaver_fit::{Fit, Judge, Photo, StrategyKind};
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::lens::{self, Lens};
use weaver_geometry::{Camera, Pose};
use weaver_kernels::random::Stream;
use weaver_scene::{Gaussians, Model};
use weaver_splat::{RasterSettings, Renderer};

const SIDE: usize = 48;

/// Gaussians on all sides.
fn around(count: usize) -> Gaussians {
    let mut scene = cloud(count, 3);
    let stream = Stream::new(3, 0, "test.lens");
    for (i, mean) in scene.means.iter_mut().enumerate() {
        let normal = |k: u64| stream.normal::<f64>(4 * i as u64 + k);
        let direction = DVec3::new(normal(0), normal(1), normal(2)).normalize_or(DVec3::X);
        *mean = ((3.0 + 0.5 * normal(3).clamp(-2.0, 2.0)) * direction).as_vec3().to_array();
    }
    scene
}

/// Photos through a fisheye of 180 degrees, whose corners see nothing.
fn photos(scene: &Gaussians) -> Vec<Photo> {
    let (intrinsics, model) = (lens::fisheye(std::f64::consts::PI, SIDE, SIDE), Model::Lens(Lens::EQUIDISTANT));
    let mut renderer = Renderer::default();
    (0..8)
        .map(|i| {
            let rotation = DMat3::from_rotation_y(0.7 * f64::from(i)) * DMat3::from_rotation_x(0.1 * f64::from(i));
            let center = DVec3::new(0.2 * f64::from(i % 3), 0.1 * f64::from(i % 2), -0.15 * f64::from(i % 4));
            let pose = Pose::new(rotation, -(rotation * center));
            let camera = Camera { pose, intrinsics, width: SIDE, height: SIDE };
            let settings = RasterSettings::default();
            let drawn = renderer.render_through(model, &scene.to_activated(), &[camera], [1.0; 3], &settings).unwrap();
            let rgb = drawn[0].iter().map(|x| (255.0 * x).round().clamp(0.0, 255.0) as u8).collect();
            let mask = (0..SIDE * SIDE).map(|at| {
                let (x, y) = ((at % SIDE) as f64 - 23.5, (at / SIDE) as f64 - 23.5);
                x.hypot(y) < 24.0
            });
            Photo { name: i.to_string(), camera, rgb, mask: Some(mask.collect()), lens: Some(Lens::EQUIDISTANT) }
        })
        .collect()
}

fn disturbed(scene: &Gaussians) -> Gaussians {
    let stream = Stream::new(4, 0, "test.lens");
    let mut scene = scene.clone();
    for (i, mean) in scene.means.iter_mut().enumerate() {
        (0..3).for_each(|k| mean[k] += 0.05 * stream.normal::<f32>((3 * i + k) as u64));
    }
    scene.sh.iter_mut().for_each(|x| *x *= 0.7);
    scene
}

fn psnr(fit: &mut Fit, photos: &[Photo]) -> f64 {
    let of = |photo: &Photo| {
        let image = fit.render_through(photo.model(), &photo.camera).unwrap();
        Judge::psnr(&image, &photo.rgb, photo.mask.as_deref())
    };
    photos.iter().map(of).sum::<f64>() / photos.len() as f64
}

/// Promise (photos): a fit to fisheye photos draws them through their lens.
#[test]
fn photos_of_a_fisheye_are_met_on_all_sides() {
    let scene = around(150);
    let photos = photos(&scene);
    let fitted = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let settings = plain(StrategyKind::Keep, 200, 150);
            let mut fit = Fit::new(photos.clone(), &disturbed(&scene), settings).unwrap();
            let before = psnr(&mut fit, &photos);
            finish(&mut fit);
            (before, psnr(&mut fit, &photos), fit.gaussians())
        })
    };
    let (before, after, gaussians) = fitted(1);
    assert!(after > before + 4.0, "from {before} to {after} dB");
    assert_eq!(gaussians, fitted(2).2, "the same bits at any number of threads");
}

/// Cameras find back to where their photos fit the scene, by what lies beside them, too.
#[test]
fn cameras_with_a_fisheye_are_located() {
    let scene = around(150);
    let photos = photos(&scene);
    let settings = plain(StrategyKind::Keep, 1, 150);
    let mut fit = Fit::new(photos.clone(), &scene, settings).unwrap();
    let truth = photos[3].camera;
    let turned = Pose::new(DMat3::from_rotation_y(0.02), DVec3::new(0.02, 0.0, 0.0)).compose(&truth.pose);
    let found = fit.locate(&photos[3], Camera { pose: turned, ..truth }, 30).unwrap();
    let (before, after) = (turned.angle_to(&truth.pose), found.pose.angle_to(&truth.pose));
    assert!(after < 0.2 * before, "from {before} to {after}");
}
