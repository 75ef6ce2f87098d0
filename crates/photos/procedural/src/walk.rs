//! Long captures: photos along a street that comes back past its beginning, and along a building whose windows repeat.

mod paint;
mod picture;
mod street;

use crate::ProceduralOptions;
use crate::draws::Draws;
use crate::path::look_at;
use picture::Block;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, PI};
use weaver_data::{Scene, View};
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::{Camera, Intrinsics};
use weaver_kernels::random::Stream;

/// Scene units (meters) from one photo to the next, and the shortest way around.
const STEP: f64 = 0.6;
const SHORTEST: f64 = 36.0;
/// The part of the way around that is walked once more.
const AGAIN: f64 = 0.1;
/// Radius of the way at corners.
const BEND: f64 = 3.0;
/// From the way to the houses outside of it and inside.
const OUTSIDE: f64 = 5.0;
const INSIDE: f64 = 4.0;
/// View angle across the width.
const FOV: f64 = 65.0;
/// Height of the eyes.
const EYES: f64 = 1.6;
/// From a long building to the way along it.
const AWAY: f64 = 7.0;

/// A capture of many photos before they are taken: each is made on demand.
///
/// Lengths are meters, the z axis points up, cameras are exact, and every photo is the same at any number of threads.
/// Boxes of all sizes, each with detail of its own from meters to millimeters, that is left out where pixels cannot
/// show it.
#[derive(Clone, Debug)]
pub struct Walk {
    name: String,
    blocks: Vec<Block>,
    cameras: Vec<Camera>,
    seed: u64,
}

impl Walk {
    /// A walk around a block of houses, 0.6 m from one photo to the next (more, where there are few), looking ahead and
    /// to the outer side; the last tenth of the way is the first once more, a little beside it.
    ///
    /// ```
    /// use weaver_procedural::{ProceduralOptions, Walk};
    /// let walk = Walk::street(1, &ProceduralOptions { width: 32, height: 24, views: 60 });
    /// assert_eq!(walk.cameras().len(), 60);
    /// assert!(walk.view(7).depth.unwrap().iter().any(|z| *z > 1.0));
    /// ```
    pub fn street(seed: u64, options: &ProceduralOptions) -> Self {
        let stream = Stream::new(seed, 0, "data.walk");
        let around = (STEP * options.views as f64 / (1.0 + AGAIN)).max(SHORTEST);
        let way = Way::around(around);
        let blocks = street::street(way.half, &mut Draws::new(stream.fork(0)));
        let step = around * (1.0 + AGAIN) / options.views as f64;
        let phase = Draws::new(stream.fork(1)).within(0.0, PI);
        let camera = |i: usize| {
            let along = step * i as f64;
            let (place, ahead) = way.at(along);
            let again = if along >= around { 1.0 } else { 0.0 };
            let swing = (along / 7.0 + phase).sin();
            let right = -ahead.perp();
            let turn = (55.0 + 20.0 * swing - 15.0 * again).to_radians();
            let eye = (place + right * (0.3 * swing + 0.6 * again)).extend(EYES + 0.1 * (along * 1.3).sin());
            let toward = (ahead * turn.cos() + right * turn.sin()).extend(0.12 + 0.08 * (along / 5.0).cos());
            photographed(eye, toward, options)
        };
        let cameras = (0..options.views).map(camera).collect();
        Self { name: format!("walk-{seed}"), blocks, cameras, seed }
    }

    /// A walk along one long building whose windows are all the same; the wall between them is not.
    pub fn facade(seed: u64, options: &ProceduralOptions) -> Self {
        let stream = Stream::new(seed, 0, "data.facade");
        let length = STEP * options.views as f64;
        let blocks = street::facade(length, &mut Draws::new(stream.fork(0)));
        let camera = |i: usize| {
            let along = STEP * (i as f64 + 0.5);
            let eye = DVec3::new(along, -AWAY - 0.4 * (along / 3.0).sin(), EYES + 0.1 * (along * 1.3).sin());
            photographed(eye, DVec3::new(0.25 * (along / 4.0).sin(), 1.0, 0.22), options)
        };
        let cameras = (0..options.views).map(camera).collect();
        Self { name: format!("facade-{seed}"), blocks, cameras, seed }
    }

    /// The cameras, in the order of the walk.
    pub fn cameras(&self) -> &[Camera] {
        &self.cameras
    }

    /// The photo of a camera, with its depth.
    ///
    /// # Panics
    /// If there is no such camera.
    pub fn view(&self, number: usize) -> View {
        self.seen_by(&self.cameras[number], number)
    }

    /// The photo of any other camera in the same world, with its depth; `number` names it and seeds its noise.
    ///
    /// ```
    /// use weaver_procedural::{ProceduralOptions, Walk};
    /// let walk = Walk::street(1, &ProceduralOptions { width: 32, height: 24, views: 60 });
    /// let camera = walk.cameras()[7];
    /// assert_eq!(walk.seen_by(&camera, 7).image.pixels, walk.view(7).image.pixels);
    /// ```
    pub fn seen_by(&self, camera: &Camera, number: usize) -> View {
        let (image, depth) =
            picture::photograph(&self.blocks, camera, (self.seed as u32).wrapping_add(number as u32 * 0x9E37));
        View {
            name: format!("{number:04}"),
            image,
            camera: *camera,
            inside: None,
            depth: Some(depth),
            instances: None,
            time: None,
            number: None,
            extras: BTreeMap::new(),
            held_out: false,
        }
    }

    /// All photos as a scene, without points.
    pub fn scene(&self) -> Scene {
        let views: Vec<View> = (0..self.cameras.len()).into_par_iter().map(|i| self.view(i)).collect();
        let visible = vec![Vec::new(); views.len()];
        let (name, points, remarks) = (self.name.clone(), Vec::new(), Vec::new());
        Scene { name, views, points, visible, scale: Some(OUTSIDE), remarks }
    }
}

/// All photos of [`Walk::street`] at once.
///
/// ```
/// use weaver_procedural::{ProceduralOptions, walk};
/// let scene = walk(1, &ProceduralOptions { width: 16, height: 12, views: 4 });
/// assert_eq!(scene.training_views().len(), 4);
/// ```
pub fn walk(seed: u64, options: &ProceduralOptions) -> Scene {
    Walk::street(seed, options).scene()
}

fn photographed(eye: DVec3, toward: DVec3, options: &ProceduralOptions) -> Camera {
    let ProceduralOptions { width, height, .. } = *options;
    let focal = width as f64 / 2.0 / (FOV / 2.0).to_radians().tan();
    let intrinsics = Intrinsics { fx: focal, fy: focal, cx: width as f64 / 2.0, cy: height as f64 / 2.0 };
    Camera { pose: look_at(eye, eye + toward, 0.0), intrinsics, width, height }
}

/// A rectangle with round corners about the origin.
#[derive(Clone, Copy, Debug)]
struct Way {
    half: DVec2,
}

impl Way {
    /// The way of some length, longer in x.
    fn around(length: f64) -> Self {
        let short = (length + (8.0 - 2.0 * PI) * BEND) / 10.4;
        Self { half: DVec2::new(1.6 * short, short) }
    }

    /// Place and direction after so much of the way, counterclockwise from the middle of a corner's end.
    fn at(&self, along: f64) -> (DVec2, DVec2) {
        let (bend, straight) = (BEND * FRAC_PI_2, 2.0 * (self.half - BEND));
        let mut along = along.rem_euclid(2.0 * straight.element_sum() + 4.0 * bend);
        let mut side = 0;
        loop {
            let ahead = DVec2::from_angle(FRAC_PI_2 * f64::from(side % 4));
            let right = -ahead.perp();
            let [half, other] = if side % 2 == 0 { [self.half.x, self.half.y] } else { [self.half.y, self.half.x] };
            let length = 2.0 * (half - BEND);
            if along < length {
                return (right * other + ahead * (along - length / 2.0), ahead);
            }
            along -= length;
            if along < bend {
                let ahead_now = DVec2::from_angle(along / BEND).rotate(ahead);
                let center = ahead * (half - BEND) + right * (other - BEND);
                return (center - ahead_now.perp() * BEND, ahead_now);
            }
            along -= bend;
            side += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_is_closed_and_without_jumps() {
        let way = Way::around(80.0);
        let (mut last, mut length) = (way.at(0.0).0, 0.0);
        for i in 1..=8000 {
            let (place, ahead) = way.at(f64::from(i) * 0.01);
            let moved = place - last;
            assert!(moved.length() < 0.0101 && moved.dot(ahead) > 0.0099, "{i}: {moved}");
            length += moved.length();
            last = place;
        }
        assert!(last.distance(way.at(0.0).0) < 1e-9 && (length - 80.0).abs() < 1e-3, "{length}");
    }

    /// A place in a photo is seen by the next ones as well, and the end of the walk shows the same as the beginning.
    #[test]
    fn photos_agree_about_what_they_show() {
        let walk = Walk::street(3, &ProceduralOptions { width: 96, height: 72, views: 40 });
        let views: Vec<View> = [4, 5, 38].map(|i| walk.view(i)).into();
        for other in &views[1..] {
            let (mut seen, mut alike, mut off) = (0, 0, 0.0);
            for (i, z) in views[0].depth.as_ref().unwrap().iter().enumerate().filter(|(_, z)| **z > 0.0) {
                let pixel = DVec2::new((i % 96) as f64 + 0.5, (i / 96) as f64 + 0.5);
                let there = other.camera.pose.apply(views[0].camera.unproject(pixel, f64::from(*z)));
                let at = other.camera.intrinsics.project(there);
                if there.z > 0.0 && at.cmpge(DVec2::ZERO).all() && at.cmplt(DVec2::new(96.0, 72.0)).all() {
                    let j = at.y as usize * 96 + at.x as usize;
                    seen += 1;
                    if (f64::from(other.depth.as_ref().unwrap()[j]) / there.z - 1.0).abs() < 0.05 {
                        alike += 1;
                        off += (views[0].image.pixels[3 * i] - other.image.pixels[3 * j]).abs();
                    }
                }
            }
            assert!(seen > 1000 && alike * 10 > seen * 7, "{alike} of {seen}");
            assert!(off / (alike as f32) < 0.08, "{}", off / alike as f32);
        }
    }

    #[test]
    fn the_same_photo_twice_and_none_from_inside_a_wall() {
        for walk in
            [Walk::street, Walk::facade].map(|walk| walk(1, &ProceduralOptions { width: 48, height: 36, views: 40 }))
        {
            assert!(walk.view(3).image.pixels == walk.view(3).image.pixels);
            let eyes = walk.cameras.iter().map(|camera| camera.pose.center());
            assert!(eyes.clone().all(|eye| walk.blocks.iter().all(|block| !block.contains(eye))));
            let sky = |z: &&f32| **z == 0.0;
            assert!((0..40).all(|i| walk.view(i).depth.unwrap().iter().filter(sky).count() < 48 * 36 / 2));
        }
    }
}
