//! Scenes generated from a seed: ray-cast planes, boxes and balls with exact cameras, depth and surface points.
//!
//! The ray caster shares no code with the Gaussian rasterizer, so these scenes are an independent test of it. A scene is a
//! pure function of its seed and options, whatever the number of threads.

mod draws;
mod path;
mod render;
mod solid;
mod texture;
mod world;

use crate::{Scene, View};
use draws::Draws;
use rayon::prelude::*;
use weaver_geometry::Camera;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_kernels::random::Stream;
use world::World;

/// Surface points marked per view.
const POINTS_PER_VIEW: usize = 16;
/// One view in this many is held out.
const HOLD_OUT: usize = 4;
/// Seeds of the default sets; any other seed is a scene neither has seen.
const TRAINING_SEED: u64 = 1000;
const UNSEEN_SEED: u64 = 2000;

/// The size of a procedural scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProceduralOptions {
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
    /// Number of views.
    pub views: usize,
}

/// Generates the scene of a seed: a patterned ground, walls, three to six objects and a flat sky, photographed along an
/// arc with a field of view near 60 degrees; every fourth view is held out.
///
/// Depth is exact at every pixel's center (0 for sky); points are surface points with exact visibility.
///
/// ```
/// use weaver_data::procedural::{ProceduralOptions, scene};
/// let scene = scene(7, &ProceduralOptions { width: 16, height: 12, views: 4 });
/// assert_eq!(scene.views[0].image.pixels.len(), 16 * 12 * 3);
/// assert_eq!(scene.held_out_views().len(), 1);
/// ```
pub fn scene(seed: u64, options: &ProceduralOptions) -> Scene {
    let stream = Stream::new(seed, 0, "data.procedural");
    let world = World::compose(&mut Draws::new(stream.fork(0)));
    let mut draws = Draws::new(stream.fork(1));
    let cameras = path::cameras(options.width, options.height, options.views, &mut draws);
    let views: Vec<View> = cameras
        .par_iter()
        .enumerate()
        .map(|(i, camera)| View {
            name: format!("{i:04}"),
            image: render::photograph(&world, camera),
            camera: *camera,
            depth: Some(render::depth(&world, camera)),
            time: None,
            number: None,
            // Not the first of four: every held-out camera then stands between training cameras.
            held_out: i % HOLD_OUT == 2,
        })
        .collect();
    let points: Vec<DVec3> =
        views.iter().enumerate().flat_map(|(i, view)| surface_points(view, stream.fork(2 + i as u64))).collect();
    let visible = cameras
        .par_iter()
        .map(|camera| (0..points.len() as u32).filter(|&p| sees(&world, camera, points[p as usize])).collect())
        .collect();
    Scene { name: format!("procedural-seed-{seed}"), views, points, visible, scale: None }
}

/// The default training set: sixteen scenes of 24 views, always the same.
pub fn default_training_set(width: usize, height: usize) -> Vec<Scene> {
    set("procedural", TRAINING_SEED, 16, width, height)
}

/// The default set for evaluation on unseen scenes: four scenes of 24 views that [`default_training_set`] does not contain.
pub fn default_unseen_set(width: usize, height: usize) -> Vec<Scene> {
    set("unseen", UNSEEN_SEED, 4, width, height)
}

fn set(name: &str, first_seed: u64, scenes: u64, width: usize, height: usize) -> Vec<Scene> {
    let options = ProceduralOptions { width, height, views: 24 };
    (0..scenes).map(|i| Scene { name: format!("{name}-{i:02}"), ..scene(first_seed + i, &options) }).collect()
}

/// Surface points under random pixels of a view.
fn surface_points(view: &View, stream: Stream) -> Vec<DVec3> {
    let camera = &view.camera;
    let depth = view.depth.as_deref().unwrap_or_default();
    let to_world = camera.pose.inverse();
    (0..POINTS_PER_VIEW as u64)
        .filter_map(|i| {
            let pixel = stream.below(i, depth.len());
            let center = DVec2::new((pixel % camera.width) as f64 + 0.5, (pixel / camera.width) as f64 + 0.5);
            let z = f64::from(depth[pixel]);
            (z > 0.0).then(|| to_world.apply(camera.intrinsics.unproject(center, z)))
        })
        .collect()
}

/// Whether a surface point lies inside the image, in front of the camera, with nothing before it.
fn sees(world: &World, camera: &Camera, point: DVec3) -> bool {
    let local = camera.pose.apply(point);
    let pixel = camera.intrinsics.project(local);
    let inside = pixel.x >= 0.0 && pixel.x < camera.width as f64 && pixel.y >= 0.0 && pixel.y < camera.height as f64;
    let eye = camera.pose.center();
    // The point itself, known to the precision of f32 depth, is no obstacle.
    local.z > 0.0 && inside && !world.blocked(eye, point - eye, 1.0 - 1e-4)
}
