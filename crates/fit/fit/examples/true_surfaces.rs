//! Fits drawn scenes, whose surfaces are known, by several losses, and prints how far depth and meshes are off:
//! `true_surfaces STEPS GAUSSIANS LONG_SIDE SEEDS [NAME=SETTINGS...]`, with seeds divided by commas and settings of
//! [`Surfaces`] as JSON; where depth has a weight, it is that of stereo, or the true one with `"true":1`.

use serde_json::Value;
use std::error::Error;
use std::time::Instant;
use weaver_fit::{Fit, FitSettings, Judge, KnownDepth, Photo, Surfaces, init, mean_color};
use weaver_geometry::glam::DVec2;
use weaver_mesh::{DistanceField, DrawnScene, SceneScale, compare, thinned};
use weaver_procedural::{ProceduralOptions, scene};
use weaver_scene::{CameraRows, PointCloud};
use weaver_splat::{Images, RasterSettings, Workspace, rasterize};
use weaver_stereo::{Stereo, StereoSettings};

/// Views of a scene, every fourth held out.
const VIEWS: usize = 40;
/// Part of the scene's size within which a place counts as met.
const NEAR: f64 = 0.01;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [steps, gaussians, side, seeds, variants @ ..] = &arguments[..] else {
        return Err("expected STEPS GAUSSIANS LONG_SIDE SEEDS [NAME=SETTINGS...]".into());
    };
    let (steps, gaussians, side): (usize, usize, usize) = (steps.parse()?, gaussians.parse()?, side.parse()?);
    println!("seed variant       |     dB   off %  within 1 % | precision  recall   F (1 %)  chamfer % | seconds");
    for seed in seeds.split(',') {
        let place = Place::drawn(seed.parse()?, side);
        for variant in variants {
            let (name, json) = variant.split_once('=').ok_or("expected NAME=SETTINGS")?;
            let mut json: Value = serde_json::from_str(json)?;
            let exact = json.as_object_mut().and_then(|keys| keys.remove("true")).is_some();
            let mut surfaces = serde_json::to_value(Surfaces::default())?;
            json.as_object().into_iter().flatten().for_each(|(key, value)| surfaces[key] = value.clone());
            let surfaces: Surfaces = serde_json::from_value(surfaces)?;
            let start = Instant::now();
            let background = mean_color(place.photos.iter().map(|(_, photo)| photo));
            let settings = FitSettings { steps, gaussians, background, surfaces, ..FitSettings::default() };
            let mut fit = place.fit(&settings, exact)?;
            while fit.steps_done() < steps {
                fit.step()?;
            }
            let seconds = start.elapsed().as_secs_f64();
            let [psnr, off, within] = place.held_out(&mut fit)?;
            let [precision, recall, f, chamfer] = place.mesh(&fit)?;
            println!(
                "{seed:4} {name:<13} | {psnr:6.2} {off:7.2} {within:11.1} | {precision:9.1} {recall:7.1} {f:9.1} \
                 {chamfer:10.2} | {seconds:7.1}"
            );
        }
    }
    Ok(())
}

/// A drawn scene with its true depth.
struct Place {
    /// Photos, and true for those that are held out.
    photos: Vec<(bool, Photo)>,
    depths: Vec<Vec<f32>>,
    points: PointCloud,
    visible: Vec<Vec<u32>>,
}

impl Place {
    fn drawn(seed: u64, side: usize) -> Self {
        let drawn = scene(seed, &ProceduralOptions { width: side, height: side * 3 / 4, views: VIEWS });
        let positions: Vec<[f32; 3]> = drawn.points.iter().map(|point| point.as_vec3().to_array()).collect();
        let colors = vec![[128; 3]; positions.len()];
        let photo = |view: &weaver_data::View| {
            let bytes = view.image.pixels.iter().map(|x| (255.0 * x).round().clamp(0.0, 255.0) as u8);
            let rgb = bytes.collect::<Vec<u8>>().into();
            (view.held_out, Photo { name: view.name.clone(), camera: view.camera, rgb, mask: None, lens: None })
        };
        Self {
            photos: drawn.views.iter().map(photo).collect(),
            depths: drawn.views.iter().map(|view| view.depth.clone().unwrap_or_default()).collect(),
            points: PointCloud { positions, colors },
            visible: drawn.visible,
        }
    }

    fn fitted(&self) -> Vec<usize> {
        (0..self.photos.len()).filter(|i| !self.photos[*i].0).collect()
    }

    /// A fit that has not begun, with what is known of depth.
    fn fit(&self, settings: &FitSettings, exact: bool) -> Result<Fit, Box<dyn Error>> {
        let fitted = self.fitted();
        let photos: Vec<Photo> = fitted.iter().map(|i| self.photos[*i].1.clone()).collect();
        let visible: Vec<Vec<u32>> = fitted.iter().map(|i| self.visible[*i].clone()).collect();
        let stereo = Stereo::of(&photos, &self.points, &visible, &StereoSettings::default());
        let initial = init::from_gaussians(&stereo.surface().gaussians(init::room(settings)), settings)?;
        let mut fit = Fit::new(photos, &initial, settings.clone())?;
        for (n, i) in fitted.iter().enumerate() {
            let (depth, size) =
                if exact { (self.depths[*i].clone(), self.photos[*i].1.size()) } else { stereo.depth(n) };
            fit.set_depth(n, KnownDepth { size, depth })?;
        }
        Ok(fit)
    }

    /// Mean PSNR of held-out photos, the median error of their depth, and the share of pixels within 1 %.
    fn held_out(&self, fit: &mut Fit) -> Result<[f64; 3], Box<dyn Error>> {
        let (mut psnr, mut errors) = (0.0, Vec::new());
        let raster = fit.raster_settings();
        let scene = fit.gaussians().to_activated();
        let held_out: Vec<usize> = (0..self.photos.len()).filter(|i| self.photos[*i].0).collect();
        for i in &held_out {
            let photo = &self.photos[*i].1;
            psnr += Judge::psnr(&fit.render(&photo.camera)?, &photo.rgb, None) / held_out.len() as f64;
            let pixels = photo.camera.width * photo.camera.height;
            let (mut image, mut alpha, mut depth) = (vec![0.0; 3 * pixels], vec![0.0; pixels], vec![0.0; pixels]);
            let images = Images { image: &mut image, alpha: &mut alpha, depth: Some(&mut depth), features: None };
            let rows = CameraRows::new(&[photo.camera]);
            let cameras = rows.as_slices(&[0.0; 3]);
            rasterize(&scene.as_slices(), &cameras, &raster, &mut Workspace::new(), images)?;
            let known = depth.iter().zip(&alpha).zip(&self.depths[*i]).filter(|(_, truth)| **truth > 0.0);
            errors.extend(known.map(|((d, a), truth)| (f64::from(d / a.max(1e-6)) / f64::from(*truth)).ln().abs()));
        }
        errors.sort_unstable_by(f64::total_cmp);
        let within = errors.partition_point(|error| *error < 0.01) as f64 / errors.len() as f64;
        Ok([psnr, 100.0 * errors[errors.len() / 2], 100.0 * within])
    }

    /// Precision, recall and F-score of the mesh within [`NEAR`] of the scene's size, and its Chamfer distance, all in
    /// percent.
    fn mesh(&self, fit: &Fit) -> Result<[f64; 4], Box<dyn Error>> {
        let fitted = self.fitted();
        let cameras: Vec<_> = fitted.iter().map(|i| self.photos[*i].1.camera).collect();
        let SceneScale { far, voxel } = SceneScale::of(&cameras, None, None).ok_or("no common point")?;
        let raster: RasterSettings = fit.raster_settings();
        let mut drawn = DrawnScene::new(&fit.gaussians(), fit.settings().background, raster, far);
        cameras.iter().try_for_each(|camera| drawn.add(camera))?;
        let mesh = DistanceField::new(&drawn.views(), voxel, 4.0 * voxel)?.mesh().manifold().largest_pieces(50, 100);
        let mut truth = Vec::new();
        for i in &fitted {
            let camera = &self.photos[*i].1.camera;
            for (pixel, z) in self.depths[*i].iter().enumerate().filter(|(_, z)| **z > 0.0) {
                let at = DVec2::new((pixel % camera.width) as f64 + 0.5, (pixel / camera.width) as f64 + 0.5);
                let place = camera.intrinsics.unproject(at, f64::from(*z));
                if place.length() < far {
                    truth.push(camera.pose.inverse().apply(place).as_vec3().to_array());
                }
            }
        }
        // `far` is twice the scene's size.
        let size = far / 2.0;
        let scaled = |points: &[[f32; 3]]| -> Vec<[f32; 3]> {
            thinned(points, voxel).iter().map(|p| p.map(|x| x / size as f32)).collect()
        };
        let errors = compare(&scaled(&mesh.vertices), &scaled(&truth), NEAR).ok_or("no mesh")?;
        let chamfer = errors.chamfer.unwrap_or(f64::NAN);
        Ok([errors.precision, errors.recall, errors.f_score, chamfer].map(|x| 100.0 * x))
    }
}
