//! Scenes generated from a seed: ray-cast planes, boxes and balls with exact cameras, depth and surface points.
//!
//! [`scene`] is plain and always the same; [`varied_scene`] is for training on scenes without end; a [`Walk`] has
//! hundreds of photos of any size; [`film`] has solids that move. [`appearance`] gives photos drawn light and
//! passers-by; [`lidar`] has sweeps of a spinning sensor through worlds of boxes.
//!
//! The ray caster shares no code with the Gaussian rasterizer, so these scenes are an independent test of it. A scene
//! is a pure function of its seed and options, at any number of threads.

pub mod appearance;
mod color;
mod draws;
pub mod lidar;
mod moving;
mod path;
mod pyramid;
mod render;
mod solid;
mod texture;
mod varied;
mod walk;
mod world;

pub use moving::{FilmOptions, MOTIONS, film};
pub use walk::{Walk, walk};

use draws::Draws;
use path::Path;
use rayon::prelude::*;
use render::{Exposure, Film};
use std::collections::BTreeMap;
use std::ops::Range;
use weaver_data::{Scene, View};
use weaver_geometry::Camera;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_kernels::random::Stream;
use world::World;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

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
/// Depth and instances are exact at every pixel's center (0 for sky); points are surface points with exact visibility.
///
/// ```
/// use weaver_procedural::{ProceduralOptions, scene};
/// let scene = scene(7, &ProceduralOptions { width: 16, height: 12, views: 4 });
/// assert_eq!(scene.views[0].image.pixels.len(), 16 * 12 * 3);
/// assert_eq!(scene.held_out_views().len(), 1);
/// ```
pub fn scene(seed: u64, options: &ProceduralOptions) -> Scene {
    let stream = Stream::new(seed, 0, "data.procedural");
    let world = World::compose(&mut Draws::new(stream.fork(0)));
    let mut draws = Draws::new(stream.fork(1));
    let cameras = Path::around(options.views, &mut draws).cameras(options, &mut draws);
    Plan { world, cameras, film: Film::PLAIN, moving_sun: false }.carried_out(format!("procedural-seed-{seed}"), stream)
}

/// The scene of a seed as [`scene`] makes it, but for the sun, which is elsewhere in every photo: shadows move, and
/// shades with them. No single change of colors makes one photo's light of another's.
///
/// ```
/// use weaver_procedural::{ProceduralOptions, scene, scene_under_moving_sun};
/// let options = ProceduralOptions { width: 16, height: 12, views: 2 };
/// let [plain, moving] = [scene(7, &options), scene_under_moving_sun(7, &options)];
/// assert!(plain.views[1].depth == moving.views[1].depth && plain.views[1].image.pixels != moving.views[1].image.pixels);
/// ```
pub fn scene_under_moving_sun(seed: u64, options: &ProceduralOptions) -> Scene {
    let stream = Stream::new(seed, 0, "data.procedural");
    let world = World::compose(&mut Draws::new(stream.fork(0)));
    let mut draws = Draws::new(stream.fork(1));
    let cameras = Path::around(options.views, &mut draws).cameras(options, &mut draws);
    Plan { world, cameras, film: Film::PLAIN, moving_sun: true }.carried_out(format!("moving-sun-{seed}"), stream)
}

/// Generates the varied scene of a seed, for training that is to carry over to real photos: a room or an open place
/// with objects of all sizes, photographed along an arc or a path straight ahead.
///
/// View angle 30 to 75 degrees, 8 to 90 degrees from the first camera to the last, roll, dead-leaves textures, a color
/// cast, small differences of exposure, noise; four rays per pixel, where [`scene`] has sixteen. Depth, points,
/// visibility and held-out views are as there.
///
/// ```
/// use weaver_procedural::{ProceduralOptions, varied_scene};
/// let options = ProceduralOptions { width: 16, height: 12, views: 4 };
/// let [a, b] = [1, 2].map(|seed| varied_scene(seed, &options));
/// assert_ne!(a.views[0].camera.intrinsics.fx, b.views[0].camera.intrinsics.fx);
/// assert!(a.views.iter().all(|view| view.depth.as_ref().unwrap().iter().any(|z| *z > 0.0)));
/// ```
pub fn varied_scene(seed: u64, options: &ProceduralOptions) -> Scene {
    let stream = Stream::new(seed, 0, "data.varied");
    let mut draws = Draws::new(stream.fork(0));
    let cameras = Path::varied(options.views, &mut draws).cameras(options, &mut draws);
    let world = World::around(&cameras, &mut Draws::new(stream.fork(1)));
    let film = Film::varied(&mut draws);
    Plan { world, cameras, film, moving_sun: false }.carried_out(format!("varied-seed-{seed}"), stream)
}

/// A scene before its photos are taken.
struct Plan {
    world: World,
    cameras: Vec<Camera>,
    film: Film,
    /// True if the sun is elsewhere in every photo.
    moving_sun: bool,
}

impl Plan {
    fn carried_out(self, name: String, stream: Stream) -> Scene {
        let Self { world, cameras, film, moving_sun } = self;
        // Draws for a view have their own stream, apart from the streams of world and cameras, 0 and 1.
        let stream_of = |view: usize| stream.fork(2 + view as u64);
        let views: Vec<View> = cameras
            .par_iter()
            .enumerate()
            .map(|(i, camera)| {
                let lit = moving_sun.then(|| world.under_another_sun(&mut Draws::new(stream_of(i).fork(1))));
                let Exposure { image, depth, instances } =
                    film.photograph(lit.as_ref().unwrap_or(&world), camera, stream_of(i).fork(0));
                View {
                    name: format!("{i:04}"),
                    image,
                    camera: *camera,
                    inside: None,
                    depth: Some(depth),
                    instances: Some(instances),
                    time: None,
                    number: None,
                    extras: BTreeMap::new(),
                    // Not the first of four: every held-out camera then stands between training cameras.
                    held_out: i % HOLD_OUT == 2,
                }
            })
            .collect();
        let points: Vec<DVec3> =
            views.iter().enumerate().flat_map(|(i, view)| surface_points(view, stream_of(i))).collect();
        let visible = cameras
            .par_iter()
            .map(|camera| (0..points.len() as u32).filter(|&p| sees(&world, camera, points[p as usize])).collect())
            .collect();
        Scene { name, views, points, visible, scale: None, remarks: Vec::new() }
    }
}

/// The default training set: sixteen scenes of 24 views, always the same.
pub fn default_training_set(width: usize, height: usize) -> Vec<Scene> {
    set("procedural", scene, TRAINING_SEED..TRAINING_SEED + 16, width, height)
}

/// The scenes of [`default_training_set`] with the sun elsewhere in every photo.
pub fn moving_sun_set(width: usize, height: usize) -> Vec<Scene> {
    set("moving-sun", scene_under_moving_sun, TRAINING_SEED..TRAINING_SEED + 16, width, height)
}

/// The default set for evaluation on unseen scenes: four scenes of 24 views that [`default_training_set`] does not
/// contain.
pub fn default_unseen_set(width: usize, height: usize) -> Vec<Scene> {
    set("unseen", scene, UNSEEN_SEED..UNSEEN_SEED + 4, width, height)
}

/// Eight [varied scenes](varied_scene) of 24 views for evaluation; training draws its seeds from all 64-bit numbers.
///
/// ```
/// let set = weaver_procedural::varied_unseen_set(16, 12);
/// assert_eq!((set.len(), set[7].name.as_str(), set[7].held_out_views().len()), (8, "varied-07", 6));
/// ```
pub fn varied_unseen_set(width: usize, height: usize) -> Vec<Scene> {
    set("varied", varied_scene, UNSEEN_SEED..UNSEEN_SEED + 8, width, height)
}

fn set(
    name: &str,
    scene: fn(u64, &ProceduralOptions) -> Scene,
    seeds: Range<u64>,
    width: usize,
    height: usize,
) -> Vec<Scene> {
    let options = ProceduralOptions { width, height, views: 24 };
    seeds.enumerate().map(|(i, seed)| Scene { name: format!("{name}-{i:02}"), ..scene(seed, &options) }).collect()
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

/// True if a surface point lies inside the image, in front of the camera, with nothing before it.
fn sees(world: &World, camera: &Camera, point: DVec3) -> bool {
    let local = camera.pose.apply(point);
    let pixel = camera.intrinsics.project(local);
    let inside = pixel.x >= 0.0 && pixel.x < camera.width as f64 && pixel.y >= 0.0 && pixel.y < camera.height as f64;
    let eye = camera.pose.center();
    // The point itself, known to the precision of f32 depth, is no obstacle.
    local.z > 0.0 && inside && !world.blocked(eye, point - eye, 1.0 - 1e-4)
}
