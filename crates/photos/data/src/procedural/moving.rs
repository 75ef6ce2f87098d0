//! Films of solids that move, ray-cast from a seed.

mod motion;
mod stage;

use super::ProceduralOptions;
use super::draws::Draws;
use super::path::Path;
use super::render;
use crate::film::pixels::Pixels;
use crate::film::shots::{Film, FilmPoint, HeldOut, Shot};
use rayon::prelude::*;
use stage::Stage;
use weaver_geometry::Camera;
use weaver_geometry::glam::DVec2;
use weaver_kernels::random::Stream;

/// One frame in this many is held out.
const HOLD_OUT: usize = 4;
/// Of each so many frames this one: every held-out time then lies between training times.
const HELD_OUT: usize = 2;
/// Times at which points are marked.
const POINT_TIMES: usize = 4;

/// Names of the kinds of motion, by the numbers in [`Shot::motion`].
pub const MOTIONS: [&str; 6] =
    ["nothing that moves", "cubic path", "random keys", "opposite shaking", "traveling pulse", "comes and goes"];

/// The size of a procedural film.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FilmOptions {
    /// Photo width, pixels.
    pub width: usize,
    /// Photo height, pixels.
    pub height: usize,
    /// Number of cameras.
    pub cameras: usize,
    /// Number of photos by each camera.
    pub frames: usize,
    /// Surface points at each of four times, or of as many as are trained on.
    pub points: usize,
}

impl Default for FilmOptions {
    fn default() -> Self {
        Self { width: 96, height: 72, cameras: 9, frames: 32, points: 700 }
    }
}

/// Generates the film of a seed: a patterned ground and walls, and solids that move in [five ways](MOTIONS),
/// photographed by cameras that stand still on an arc.
///
/// Frame f of F has the time f / F. The middle one of three or more cameras is held out, and every fourth frame. Points
/// are exact surface points under random pixels of training photos at four times, in the colors of those pixels; the
/// sky is the background.
///
/// ```
/// use weaver_data::film::{FilmOptions, procedural};
/// let film = procedural(7, &FilmOptions { width: 16, height: 12, cameras: 3, frames: 8, points: 5 });
/// assert_eq!((film.shots.len(), film.training().len(), film.points.len()), (24, 12, 20));
/// assert_eq!(film.times()[..3], [0.0, 0.125, 0.25]);
/// ```
pub fn procedural(seed: u64, options: &FilmOptions) -> Film {
    let FilmOptions { width, height, cameras: views, frames, points } = *options;
    let stream = Stream::new(seed, 0, "data.film");
    let stage = Stage::compose(&mut Draws::new(stream.fork(0)));
    let mut draws = Draws::new(stream.fork(1));
    let arc = ProceduralOptions { width, height, views };
    let cameras = Path::around(views, &mut draws).cameras(&arc, &mut draws);
    let taken: Vec<(Shot, Vec<f32>)> = (0..frames * views)
        .into_par_iter()
        .map(|i| {
            let (frame, viewpoint) = (i / views, i % views);
            let held_out = HeldOut { camera: views > 2 && viewpoint == views / 2, time: frame % HOLD_OUT == HELD_OUT };
            let name = format!("camera {viewpoint}, frame {frame}");
            let time = frame as f64 / frames as f64;
            photograph(&stage, Shot { name, held_out, ..unexposed(cameras[viewpoint], viewpoint, time) })
        })
        .collect();
    let mut marked = Vec::new();
    for (i, frame) in point_frames(frames).into_iter().enumerate() {
        let shots: Vec<&(Shot, Vec<f32>)> =
            taken[frame * views..(frame + 1) * views].iter().filter(|(shot, _)| shot.held_out.trained()).collect();
        marked.extend(surface_points(&shots, points, stream.fork(2 + i as u64)));
    }
    Film {
        name: format!("film-seed-{seed}"),
        size: [height, width],
        shots: taken.into_iter().map(|(shot, _)| shot).collect(),
        points: marked,
        background: stage.sky().as_vec3().to_array(),
        remarks: Vec::new(),
    }
}

fn unexposed(camera: Camera, viewpoint: usize, time: f64) -> Shot {
    let held_out = HeldOut::default();
    Shot { name: String::new(), camera, viewpoint, time, pixels: Pixels::Kept(Vec::new()), motion: None, held_out }
}

/// The photo of the stage at the time of the shot, and its depth.
fn photograph(stage: &Stage, shot: Shot) -> (Shot, Vec<f32>) {
    let (world, kinds) = stage.at(shot.time);
    // Nothing of a plain photo is random.
    let exposure = render::Film::PLAIN.photograph(&world, &shot.camera, Stream::new(0, 0, "data.film.exposure"));
    let kind = |&instance: &u16| if instance == 0 { 0 } else { kinds[usize::from(instance) - 1] };
    let motion = Some(exposure.instances.iter().map(kind).collect());
    (Shot { pixels: Pixels::Kept(exposure.image.to_bytes()), motion, ..shot }, exposure.depth)
}

/// The frames at which points are marked: in the middles of equal parts of the clip, none of them held out.
fn point_frames(frames: usize) -> Vec<usize> {
    let middle = |part: usize| (2 * part + 1) * frames / (2 * POINT_TIMES);
    let mut chosen: Vec<usize> = (0..POINT_TIMES)
        .map(middle)
        .filter(|&frame| frame < frames)
        .map(|frame| if frame % HOLD_OUT == HELD_OUT { frame - 1 } else { frame })
        .collect();
    chosen.dedup();
    chosen
}

/// Surface points under random pixels with known depth, in photos of one time; fewer where there is hardly anything but
/// sky.
fn surface_points(shots: &[&(Shot, Vec<f32>)], wanted: usize, stream: Stream) -> Vec<FilmPoint> {
    let pixels: usize = shots.iter().map(|(_, depth)| depth.len()).sum();
    if pixels == 0 {
        return Vec::new();
    }
    // Half of all pixels are sky at worst: twenty draws for each point are enough.
    let drawn = (0..20 * wanted as u64).map(|i| stream.below(i, pixels));
    let marked = drawn.filter_map(|pixel| {
        let (shot, depth) = shots[pixel / shots[0].1.len()];
        let pixel = pixel % depth.len();
        let z = f64::from(depth[pixel]);
        let center = DVec2::new((pixel % shot.camera.width) as f64 + 0.5, (pixel / shot.camera.width) as f64 + 0.5);
        let Pixels::Kept(bytes) = &shot.pixels else { unreachable!("generated photos are in memory") };
        let color = [0, 1, 2].map(|c| f32::from(bytes[3 * pixel + c]) / 255.0);
        (z > 0.0).then(|| FilmPoint { position: shot.camera.unproject(center, z), color, time: shot.time })
    });
    marked.take(wanted).collect()
}

#[cfg(test)]
mod tests {
    use super::super::world::trace;
    use super::*;

    const SMALL: FilmOptions = FilmOptions { width: 48, height: 36, cameras: 3, frames: 8, points: 40 };

    fn stage(seed: u64) -> Stage {
        Stage::compose(&mut Draws::new(Stream::new(seed, 0, "data.film").fork(0)))
    }

    /// Shadows fall on still objects: their colors change, and nothing else.
    #[test]
    fn what_changes_its_depth_is_said_to_move() {
        let stage = stage(3);
        let film = procedural(3, &SMALL);
        let first = &film.shots[0];
        let [before, after] = [0.125, 0.5].map(|time| photograph(&stage, Shot { time, ..first.clone() }));
        let motion = [&before, &after].map(|(shot, _)| shot.motion.clone().unwrap());
        let (mut still, mut moving) = (0, 0);
        for (pixel, (a, b)) in before.1.iter().zip(&after.1).enumerate() {
            if motion.iter().all(|motion| motion[pixel] == 0) {
                assert_eq!(a, b, "pixel {pixel}");
                still += 1;
            } else {
                moving += usize::from(a != b);
            }
        }
        assert!(still > 1000 && moving > 100, "{still} {moving}");
    }

    /// A rasterizer has one color behind everything: the color of every pixel of the sky, to the bit.
    #[test]
    fn the_sky_is_the_background() {
        let mut sky = 0;
        for seed in 0..4 {
            let film = procedural(seed, &FilmOptions { frames: 1, ..SMALL });
            assert_eq!(film.shots.len(), 3);
            for shot in &film.shots {
                let (shot, depth) = photograph(&stage(seed), shot.clone());
                // No solid is so small that it reaches into a pixel and is seen at none of the nine centers around.
                let (width, photo) = (SMALL.width, shot.image(film.size).unwrap());
                let empty = |at: usize| {
                    let near = [at - width, at, at + width].into_iter().flat_map(|at| at - 1..=at + 1);
                    (1..width - 1).contains(&(at % width)) && near.into_iter().all(|i| depth[i] == 0.0)
                };
                for at in (width + 1..width * 12).filter(|&at| empty(at)) {
                    assert_eq!(photo.pixels[3 * at..3 * at + 3], film.background, "seed {seed}");
                    sky += 1;
                }
            }
        }
        assert!(sky > 300, "{sky} pixels of sky");
    }

    #[test]
    fn points_lie_on_what_is_seen_at_their_time() {
        let film = procedural(2, &SMALL);
        assert_eq!(film.points.len(), 4 * 40);
        let stage = stage(2);
        let trained: Vec<&Shot> = film.shots.iter().filter(|shot| shot.held_out.trained()).collect();
        let mut moved = 0;
        for point in &film.points {
            let (world, kinds) = stage.at(point.time);
            let solids: Vec<_> = world.solids.iter().collect();
            let seen = trained.iter().filter(|shot| shot.time == point.time).find_map(|shot| {
                let eye = shot.camera.pose.center();
                let hit = trace(&solids, eye, point.position - eye).filter(|hit| (hit.t - 1.0).abs() < 1e-5)?;
                let pixel = shot.camera.intrinsics.project(shot.camera.pose.apply(point.position));
                let at = pixel.y as usize * SMALL.width + pixel.x as usize;
                let bytes = shot.pixels.bytes().unwrap();
                let shown = bytes.get(3 * at..3 * at + 3)?;
                let color = [0, 1, 2].map(|c| f32::from(shown[c]) / 255.0);
                let kind = kinds[world.solids.iter().position(|solid| std::ptr::eq(solid, hit.solid))?];
                (color == point.color).then_some(kind)
            });
            let kind = seen.unwrap_or_else(|| panic!("{point:?} is not what a training photo shows"));
            moved += usize::from(kind > 0);
        }
        assert!((5..80).contains(&moved), "{moved} points on what moves");
    }

    #[test]
    fn points_are_marked_at_times_that_are_trained_on() {
        assert_eq!(point_frames(32), [4, 12, 20, 28]);
        for frames in 1..50 {
            let chosen = point_frames(frames);
            assert!(!chosen.is_empty() && chosen.iter().all(|frame| frame % HOLD_OUT != HELD_OUT && *frame < frames));
        }
    }
}
