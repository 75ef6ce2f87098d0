//! Losses of surfaces beside that of photos.

use crate::scenes::{SIZE, camera, finish, plain};
use weaver_fit::{Fit, FitError, FitSettings, KnownDepth, Photo, Rates, StrategyKind, Surfaces};
use weaver_scene::{CameraRows, Gaussians};
use weaver_splat::{Images, RasterSettings, Workspace, rasterize};

const PIXELS: usize = SIZE[0] * SIZE[1];

/// A gray wall before a gray background, four units away: its photos say nothing of its depth.
fn wall() -> (Vec<Photo>, Gaussians) {
    let places: Vec<[f32; 3]> =
        (0..24 * 18).map(|i| [(i % 24) as f32 * 0.25 - 2.9, (i / 24) as f32 * 0.25 - 2.1, 4.0]).collect();
    let count = places.len();
    let wall = Gaussians {
        means: places,
        log_scales: vec![[-1.6, -1.7, -1.8]; count],
        quats: vec![[1.0, 0.1, -0.2, 0.3]; count],
        opacity_logits: vec![2.0; count],
        sh: vec![0.0; 3 * count],
        degree: 0,
    };
    let photo = |x: f64| Photo {
        name: format!("{x}"),
        camera: camera(x, 0.0),
        rgb: vec![128; 3 * PIXELS].into(),
        mask: None,
        lens: None,
    };
    ([-0.4, 0.0, 0.4].map(photo).into(), wall)
}

fn settings(surfaces: Surfaces, count: usize) -> FitSettings {
    let settings = plain(StrategyKind::Keep, 150, count);
    // A short run goes far.
    let rates = Rates { means: 1e-2, quats: 1e-2, ..settings.rates };
    FitSettings { surfaces, rates, background: [0.5; 3], ..settings }
}

/// Mean depth of the middle of a photo.
fn depth(scene: &Gaussians, photo: &Photo) -> f64 {
    let (mut image, mut alpha, mut depth) = (vec![0.0; 3 * PIXELS], vec![0.0; PIXELS], vec![0.0; PIXELS]);
    let images = Images { image: &mut image, alpha: &mut alpha, depth: Some(&mut depth), features: None };
    let rows = CameraRows::new(&[photo.camera]);
    let scene = scene.to_activated();
    let cameras = rows.as_slices(&[0.0; 3]);
    rasterize(&scene.as_slices(), &cameras, &RasterSettings::default(), &mut Workspace::new(), images).unwrap();
    let row = &depth[PIXELS / 2..][4..28];
    row.iter().zip(&alpha[PIXELS / 2..][4..28]).map(|(d, a)| f64::from(d / a)).sum::<f64>() / row.len() as f64
}

/// Promise (fits): Gaussians go to the depth that is known of photos, also where photos show nothing of it.
#[test]
fn known_depth_pulls() {
    let (photos, wall) = wall();
    let fitted = |surfaces: Surfaces| {
        let mut fit = Fit::new(photos.clone(), &wall, settings(surfaces, wall.len())).unwrap();
        for photo in 0..photos.len() {
            // Half the photo's size, and nothing known of the upper half.
            let depth = (0..PIXELS / 4).map(|i| if i < PIXELS / 8 { 0.0 } else { 3.6 }).collect();
            fit.set_depth(photo, KnownDepth { size: [SIZE[1] / 2, SIZE[0] / 2], depth }).unwrap();
        }
        finish(&mut fit);
        depth(&fit.gaussians(), &photos[1])
    };
    let (without, with) = (fitted(Surfaces::default()), fitted(Surfaces { depth: 30.0, ..Surfaces::default() }));
    assert!((without - 3.6).abs() > 0.1 && (with - 3.6).abs() < 0.02, "{without}, {with}");
}

/// Promise of `known_depth_pulls`.
#[test]
fn normals_turn_to_the_surface() {
    let (photos, wall) = wall();
    // How far the shortest axes are off the wall's normal: 1 - |cos|.
    let off = |scene: &Gaussians| {
        let of = |i: usize| {
            let [w, x, y, z] = scene.quats[i];
            let [rx, ry, rz] = scene.log_scales[i];
            let square = w * w + x * x + y * y + z * z;
            let along = match () {
                () if rx <= ry && rx <= rz => 2.0 * (x * z - w * y) / square,
                () if ry <= rz => 2.0 * (y * z + w * x) / square,
                () => 1.0 - 2.0 * (x * x + y * y) / square,
            };
            1.0 - f64::from(along.abs())
        };
        (0..scene.len()).map(of).sum::<f64>() / scene.len() as f64
    };
    let surfaces = Surfaces { normals: 30.0, normals_from: 0.0, ..Surfaces::default() };
    let mut settings = settings(surfaces, wall.len());
    // The wall stays as it is.
    (settings.rates.means, settings.rates.scales) = (0.0, 0.0);
    let mut fit = Fit::new(photos, &wall, settings).unwrap();
    finish(&mut fit);
    let (before, after) = (off(&wall), off(&fit.gaussians()));
    assert!(after < 0.5 * before, "{before} to {after}");
}

#[test]
fn depth_of_another_shape_is_refused() {
    let (photos, wall) = wall();
    let mut fit = Fit::new(photos, &wall, settings(Surfaces::FOR_MESHES, wall.len())).unwrap();
    for (size, count) in [([10, 32], 320), ([12, 16], 100), ([0, 0], 0)] {
        let known = KnownDepth { size, depth: vec![1.0; count] };
        assert!(matches!(fit.set_depth(0, known), Err(FitError::Photo { .. })), "{size:?}");
    }
}
