//! Agreement of photos on depth.

use crate::picture::Picture;
use crate::search::Found;
use crate::speckles;
use crate::warp::Warp;
use weaver_kernels::parallel;

/// Depth of a photo that other photos agree about.
#[derive(Clone, Debug, Default)]
pub(crate) struct Map {
    /// Inverse depth of each pixel; not a number where photos do not agree.
    pub w: Vec<f32>,
    /// Slopes of the planes.
    pub slope: Vec<[f32; 2]>,
}

/// A photo agrees if its own depth leads back to within so many pixels of the start ...
const AWAY: f32 = 1.0;
/// ... and inverse depths differ by no more than this part of them, or of the largest there is.
const DIFFERENT: f32 = 0.01;
const OF_RANGE: f32 = 0.002;
/// Photos that must agree at a low cost, and the limit of the cost; from `MANY` on, photos agree at any cost.
const TWO: u8 = 2;
const COST: f32 = 0.5;
const MANY: u8 = 3;
/// Depths that differ by less go into the mean.
const ALIKE: f32 = 0.015;

/// The maps of photos, each compared with its neighbors here.
pub(crate) fn agree(pictures: &[Picture], found: &[Found], near: &[&[usize]]) -> Vec<Map> {
    let mut maps: Vec<Map> = vec![Map::default(); pictures.len()];
    parallel::for_chunks(&mut maps, 1, |n, to| to[0] = map(n, pictures, found, near[n]));
    maps
}

fn map(photo: usize, pictures: &[Picture], found: &[Found], near: &[usize]) -> Map {
    let (picture, own) = (&pictures[photo], &found[photo]);
    let (width, height) = (picture.camera.width, picture.camera.height);
    let near = near.iter().filter(|other| !found[**other].planes.is_empty());
    let ways: Vec<_> = near
        .map(|other| {
            let other = (&pictures[*other], &found[*other]);
            (other, Warp::new(&picture.camera, &other.0.camera), Warp::new(&other.0.camera, &picture.camera))
        })
        .collect();
    let mut w = vec![f32::NAN; width * height];
    let mut witnesses = vec![0; width * height];
    for (at, plane) in own.planes.iter().enumerate().filter(|(at, _)| picture.counts[*at]) {
        let pixel = [(at % width) as f32 + 0.5, (at / width) as f32 + 0.5];
        let (mut sum, mut summed) = (0.0, 1.0);
        for ((other, theirs), there, back) in &ways {
            let Some(([x, y], w)) = there.place(pixel, plane.w) else { continue };
            let camera = &other.camera;
            if x < 0.0 || y < 0.0 || x >= camera.width as f32 || y >= camera.height as f32 {
                continue;
            }
            let shown = theirs.planes[y as usize * camera.width + x as usize].w;
            let Some(([u, v], returned)) = back.place([x, y], shown) else { continue };
            let away = ((u - pixel[0]).powi(2) + (v - pixel[1]).powi(2)).sqrt();
            if away < AWAY && (w - shown).abs() < (DIFFERENT * w).max(OF_RANGE * theirs.most) {
                witnesses[at] += 1;
            }
            let ratio = (returned / plane.w).ln();
            if ratio.abs() < ALIKE {
                sum += ratio;
                summed += 1.0;
            }
        }
        if witnesses[at] >= MANY || witnesses[at] >= TWO && own.costs[at] < COST {
            w[at] = plane.w * (sum / summed).exp();
        }
    }
    speckles::remove(&mut w, &witnesses, width);
    let mut slope: Vec<[f32; 2]> = own.planes.iter().map(|plane| plane.slope).collect();
    // A photo without neighbors has no planes.
    slope.resize(w.len(), [0.0; 2]);
    Map { w, slope }
}
