//! Draws panoramas along a street: `panoramas OUT [COUNT [WIDTH [STEP]]]` writes OUT/photos with Photo Sphere records,
//! and OUT/truth.json with the exact cameras of the faces that `splatweaver cameras` cuts them into.
//!
//! `panoramas OUT COUNT WIDTH STEP DEGREES` writes photos of a fisheye with this field of view across their width,
//! three quarters as high, and OUT/truth.json with their cameras.

use rayon::prelude::*;
use std::error::Error;
use std::path::Path;
use weaver_geometry::glam::{DMat3, DVec2, DVec3};
use weaver_geometry::{Camera, Distortion, Intrinsics, Pose};
use weaver_io::{Bitmap, Transforms, jpeg_of_panorama};
use weaver_procedural::{ProceduralOptions, Walk};
use weaver_scene::Frame;

/// Field of view of the faces that are drawn and cut, degrees.
const FOV: f64 = 95.0;
/// Pixels of a drawn face over a cut one's.
const FINER: f64 = 1.5;
const NAMES: [&str; 6] = ["front", "right", "back", "left", "up", "down"];

fn turn(face: usize) -> DMat3 {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let (right, down) = [(x, y), (-z, y), (-x, y), (z, y), (x, z), (x, -z)][face];
    DMat3::from_cols(right, down, right.cross(down)).transpose()
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let out = Path::new(arguments.first().map_or("panoramas", String::as_str));
    let number = |i: usize, usual: usize| arguments.get(i).map_or(Ok(usual), |text| text.parse());
    let (count, width, step) = (number(1, 12)?, number(2, 2048)?, number(3, 3)?);
    let options = ProceduralOptions { width: 64, height: 48, views: 60 };
    let walk = Walk::street(3, &options);
    let half_tan = (0.5 * FOV.to_radians()).tan();
    let camera = |pose: Pose, side: usize| {
        let focal = 0.5 * side as f64 / half_tan;
        let intrinsics = Intrinsics { fx: focal, fy: focal, cx: side as f64 / 2.0, cy: side as f64 / 2.0 };
        Camera { pose, intrinsics, width: side, height: side }
    };
    let side = (width as f64 / std::f64::consts::PI * half_tan).round() as usize;
    let fisheye =
        arguments.get(4).map(|text| text.parse::<f64>()).transpose()?.map(|degrees| Fisheye::new(width, degrees));
    std::fs::create_dir_all(out.join("photos"))?;
    let mut frames = Vec::new();
    for panorama in 0..count {
        let level = walk.cameras()[(step * panorama) % options.views].pose;
        // Cameras on sticks are turned at will, and a little tilted.
        let tilt =
            DMat3::from_rotation_z(0.06 * (panorama as f64).sin()) * DMat3::from_rotation_y(0.7 * panorama as f64);
        let front = Pose::new(tilt, DVec3::ZERO).compose(&level);
        let pose = |face: usize| Pose::new(turn(face), DVec3::ZERO).compose(&front);
        let drawn: Vec<(Camera, Vec<u8>)> = (0..6)
            .into_par_iter()
            .map(|face| {
                let camera = camera(pose(face), (FINER * side as f64) as usize);
                (camera, walk.seen_by(&camera, 6 * panorama + face).image.to_bytes())
            })
            .collect();
        let height = if fisheye.is_some() { 3 * width / 4 } else { width / 2 };
        let mut pixels = vec![0; 3 * width * height];
        pixels.par_chunks_exact_mut(3).enumerate().for_each(|(i, pixel)| {
            let at = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let direction = fisheye.as_ref().map_or_else(|| sphere(at, width), |lens| lens.ray(at));
            let of_face = |face: usize| turn(face) * direction;
            let face = (0..6).max_by(|a, b| of_face(*a).z.total_cmp(&of_face(*b).z)).unwrap_or(0);
            let (camera, bytes) = &drawn[face];
            let color = bilinear(bytes, camera.width, camera.intrinsics.project(of_face(face)) - 0.5);
            pixel.copy_from_slice(&color);
        });
        let jpeg = Bitmap { width, height, pixels }.to_jpeg(95)?;
        if let Some(lens) = &fisheye {
            let name = format!("photos/{panorama:02}.jpg");
            std::fs::write(out.join(&name), jpeg)?;
            frames.push(lens.frame(name, front, [height, width]));
            continue;
        }
        std::fs::write(out.join(format!("photos/{panorama:02}.jpg")), jpeg_of_panorama(jpeg, (width, height)))?;
        let of_face = |face: usize| format!("faces/{panorama:02}-{}.jpg", NAMES[face]);
        frames.extend((0..6).map(|face| Frame::new(of_face(face), camera(pose(face), side))));
        println!("{panorama:02}.jpg");
    }
    Transforms { frames, ..Transforms::default() }.write(out.join("truth.json"))?;
    Ok(())
}

/// The direction at a pixel of an equirectangular picture.
fn sphere(at: DVec2, width: usize) -> DVec3 {
    let longitude = (at.x / width as f64 - 0.5) * std::f64::consts::TAU;
    let latitude = (at.y / width as f64 - 0.25) * std::f64::consts::TAU;
    DVec3::new(latitude.cos() * longitude.sin(), latitude.sin(), latitude.cos() * longitude.cos())
}

/// A fisheye whose principal point is a hundredth of the width off the middle.
struct Fisheye {
    focal: f64,
    center: DVec2,
}

impl Fisheye {
    const K: [f64; 4] = [0.03, -0.012, 0.004, -0.0008];

    fn new(width: usize, degrees: f64) -> Self {
        let half = 0.5 * degrees.to_radians();
        let focal = 0.5 * width as f64 / Self::bent(half);
        Self { focal, center: DVec2::new(0.51, 0.37) * width as f64 }
    }

    fn bent(angle: f64) -> f64 {
        let (a2, [k1, k2, k3, k4]) = (angle * angle, Self::K);
        angle * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
    }

    fn ray(&self, at: DVec2) -> DVec3 {
        let off = (at - self.center) / self.focal;
        let (mut low, mut high) = (0.0, 2.2);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            *(if Self::bent(middle) < off.length() { &mut low } else { &mut high }) = middle;
        }
        (off.normalize_or_zero() * low.sin()).extend(low.cos())
    }

    fn frame(&self, name: String, pose: Pose, [height, width]: [usize; 2]) -> Frame {
        let intrinsics = Intrinsics { fx: self.focal, fy: self.focal, cx: self.center.x, cy: self.center.y };
        let distortion = Some(Distortion::Fisheye { k: Self::K });
        Frame { distortion, ..Frame::new(name, Camera { pose, intrinsics, width, height }) }
    }
}

fn bilinear(bytes: &[u8], side: usize, at: DVec2) -> [u8; 3] {
    let at = at.clamp(DVec2::ZERO, DVec2::splat(side as f64 - 1.001));
    let (x, y) = (at.x as usize, at.y as usize);
    let (s, t) = (at.x - x as f64, at.y - y as f64);
    let value = |dx: usize, dy: usize, c: usize| f64::from(bytes[3 * ((y + dy) * side + x + dx) + c]);
    std::array::from_fn(|c| {
        let [above, below] = [0, 1].map(|dy| (1.0 - s) * value(0, dy, c) + s * value(1, dy, c));
        ((1.0 - t) * above + t * below).round() as u8
    })
}
