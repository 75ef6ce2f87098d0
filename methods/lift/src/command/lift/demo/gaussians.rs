//! Gaussians of a built-in scene, with the thing of each.

use weaver_command::Failure;
use weaver_data::{Scene, View};
use weaver_fit::{Fit, FitSettings, Photo, init};
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_inference::{Density, Predictor, predict_group};
use weaver_kernels::random::Stream;
use weaver_procedural::{ProceduralOptions, scene};
use weaver_router::AllocationKind;
use weaver_scene::{ActivatedGaussians, Gaussians, PointCloud};

/// Photos in one pass of the network.
const NETWORK_VIEWS: usize = 4;

/// Steps of a fit, and its most Gaussians.
const FIT_STEPS: usize = 600;
const FIT_GAUSSIANS: usize = 12_000;

/// Gaussians, and for each the number of its thing, 0 for the sky.
#[derive(Debug, Default)]
pub struct Labeled {
    pub gaussians: ActivatedGaussians,
    pub labels: Vec<u32>,
}

/// The number of a pixel's thing.
pub fn id(view: &View, pixel: usize) -> u32 {
    view.instances.as_ref().and_then(|ids| ids.get(pixel)).map_or(0, |id| u32::from(*id))
}

/// Balls on the surfaces: one for every `step`-th pixel of every second training view, with half this stride as their
/// deviation.
pub fn surface(scene: &Scene, seed: u64, step: usize) -> Labeled {
    let stream = Stream::new(seed, 0, "lift.demo");
    let mut made = Labeled::default();
    for view in scene.training_views().into_iter().step_by(2).map(|v| &scene.views[v]) {
        let (camera, depth) = (&view.camera, view.depth.as_deref().unwrap_or_default());
        let places = (step / 2..camera.height)
            .step_by(step)
            .flat_map(|y| (step / 2..camera.width).step_by(step).map(move |x| (x, y)));
        for (x, y) in places {
            let at = y * camera.width + x;
            let z = f64::from(depth[at]);
            if z == 0.0 {
                continue;
            }
            let point = camera.unproject(DVec2::new(x as f64 + 0.5, y as f64 + 0.5), z);
            let logit = 2.0 + stream.normal::<f32>(made.labels.len() as u64);
            let splats = &mut made.gaussians;
            splats.means.extend(point.as_vec3().to_array());
            splats.scales.extend([(0.5 * step as f64 * z / camera.intrinsics.fx) as f32; 3]);
            splats.quats.extend([1.0, 0.0, 0.0, 0.0]);
            splats.opacities.push(1.0 / (1.0 + (-logit).exp()));
            splats.sh.extend([0.0; 3]);
            made.labels.push(id(view, at));
        }
    }
    made
}

/// A network's Gaussians from the training photos, one for each pixel, with the instance of this pixel.
pub fn predicted(predictor: &mut dyn Predictor, seed: u64, views: usize) -> Result<Labeled, Failure> {
    let [height, width] = predictor.image_size();
    let scene = scene(seed, &ProceduralOptions { width, height, views });
    let one_each = Density { allocation: Some(AllocationKind::Fixed(1)), budget: None };
    // A network without this choice makes one for each pixel anyway.
    let density = predictor.density(one_each).or_else(|_| predictor.density(Density::default()))?;
    let mut made = Labeled::default();
    for group in scene.training_views().chunks(NETWORK_VIEWS) {
        let stream = Stream::new(seed, group[0] as u64, "lift.demo.predicted");
        let more = predict_group(predictor, &scene, group, density, stream)?;
        let expected = group.len() * width * height;
        if more.len() != expected {
            let found = more.len();
            return Err(Failure::message(format!(
                "--run: expected a network that makes one Gaussian of each of {expected} pixels, found {found}"
            )));
        }
        append(&mut made.gaussians, &more);
        let pixels = || 0..width * height;
        made.labels.extend(group.iter().flat_map(|v| pixels().map(|pixel| id(&scene.views[*v], pixel))));
    }
    Ok(made)
}

/// The Gaussians of a short fit to the training photos, initialized on points of the scene; the thing of each is
/// visible at its center in the view with the nearest surface there.
pub fn fitted(scene: &Scene, seed: u64) -> Result<Labeled, Failure> {
    let photo = |v: &usize| {
        let View { name, camera, image, .. } = &scene.views[*v];
        Photo { name: name.clone(), camera: *camera, rgb: image.to_bytes().into(), mask: None, lens: None }
    };
    let photos: Vec<Photo> = scene.training_views().iter().map(photo).collect();
    let positions: Vec<[f32; 3]> = scene.points.iter().map(|point| point.as_vec3().to_array()).collect();
    let points = PointCloud { colors: vec![[128; 3]; positions.len()], positions };
    let settings =
        FitSettings { seed, steps: FIT_STEPS, gaussians: FIT_GAUSSIANS, sh_degree: 0, ..FitSettings::default() };
    let initial = init::from_points(&points, &settings)?;
    let mut fit = Fit::new(photos, &initial, settings)?;
    while fit.steps_done() < fit.settings().steps {
        fit.step()?;
    }
    let mut made = Labeled::default();
    append(&mut made.gaussians, &fit.gaussians());
    let means = made.gaussians.means.as_chunks::<3>().0;
    made.labels = means.iter().map(|mean| shown_nearest(scene, DVec3::from(mean.map(f64::from)))).collect();
    Ok(made)
}

/// The instance visible at a point's pixel, in the view with the surface nearest to the point, relative to its depth.
fn shown_nearest(scene: &Scene, point: DVec3) -> u32 {
    let mut best = (f64::INFINITY, 0);
    for view in &scene.views {
        let Some(pixel) = pixel_of(&view.camera, point) else { continue };
        let (depth, z) =
            (view.depth.as_ref().map_or(0.0, |depth| f64::from(depth[pixel])), view.camera.pose.apply(point).z);
        // The sky counts as far.
        let apart = if depth > 0.0 { (z / depth - 1.0).abs() } else { 1.0 };
        if apart < best.0 {
            best = (apart, id(view, pixel));
        }
    }
    best.1
}

/// The pixel of a point, if it is inside the image.
pub fn pixel_of(camera: &weaver_geometry::Camera, point: DVec3) -> Option<usize> {
    let local = camera.pose.apply(point);
    let pixel = camera.intrinsics.project(local);
    let inside = |x: f64, size: usize| x >= 0.0 && x < size as f64;
    let seen = local.z > 0.0 && inside(pixel.x, camera.width) && inside(pixel.y, camera.height);
    seen.then(|| pixel.y as usize * camera.width + pixel.x as usize)
}

/// Appends Gaussians, without their colors.
fn append(all: &mut ActivatedGaussians, more: &Gaussians) {
    let ActivatedGaussians { means, scales, quats, opacities, .. } = more.to_activated();
    all.sh.extend(vec![0.0; 3 * opacities.len()]);
    all.means.extend(means);
    all.scales.extend(scales);
    all.quats.extend(quats);
    all.opacities.extend(opacities);
}
