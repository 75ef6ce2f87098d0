//! Depth maps of posed photos.

use crate::agreement::{Map, agree};
use crate::patch::patches;
use crate::picture::{LONGEST, PIXELS, Picture};
use crate::search::{Found, Plane, Round, Search, Source, Task};
use crate::sources::neighbors;
use crate::warp::Warp;
use std::borrow::Borrow;
use std::collections::VecDeque;
use weaver_geometry::glam::DVec3;
use weaver_kernels::order::nth;
use weaver_kernels::parallel;
use weaver_kernels::random::Stream;
use weaver_scene::{Photo, PointCloud};

/// Settings of [`Stereo`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StereoSettings {
    /// Longest side that photos are shrunk to, pixels.
    pub long_side: usize,
    /// Photos by which the depth of a photo is found.
    pub sources: usize,
    /// Seed of all that is drawn at random.
    pub seed: u64,
}

impl Default for StereoSettings {
    fn default() -> Self {
        Self { long_side: 200, sources: 3, seed: 0 }
    }
}

/// Depth that photos agree about.
#[derive(Debug)]
pub struct Stereo {
    pub(crate) pictures: Vec<Picture>,
    pub(crate) maps: Vec<Map>,
    pub(crate) neighbors: Vec<Vec<usize>>,
    visible: Vec<Vec<u32>>,
    points: PointCloud,
}

/// Rounds of the first pass, and of the second, which uses the first one's results for the other photos.
const ROUNDS: [usize; 2] = [6, 2];
/// Size of random changes in the first round of a pass, pixels between photos, and its factor from round to round.
const SIZES: [[f32; 2]; 2] = [[4.0, 0.6], [0.5, 0.5]];
/// Rounds in which inverse depths are drawn anew.
const FRESH: usize = 2;
/// The largest inverse depth that is tried, over the one that 99 of 100 points stay below.
const MARGIN: f32 = 3.0;
/// Photos that are checked for agreement.
const WITNESSES: usize = 8;

impl Stereo {
    /// The depth of photos; each sees the points of these indices. Photos without neighbors, or without points, have
    /// none.
    ///
    /// Cost: 250 planes tried in each pixel at [`StereoSettings::long_side`]. The same bits at any number of threads.
    ///
    /// # Panics
    /// Unless there are as many lists as photos.
    pub fn of<P: Borrow<Photo> + Sync>(
        photos: &[P],
        points: &PointCloud,
        visible: &[Vec<u32>],
        settings: &StereoSettings,
    ) -> Self {
        assert_eq!(photos.len(), visible.len(), "a list of points for each photo");
        let mut pictures: Vec<Option<Picture>> = photos.iter().map(|_| None).collect();
        parallel::for_chunks(&mut pictures, 1, |n, to| {
            to[0] = Some(Picture::of(photos[n].borrow(), settings.long_side))
        });
        let pictures: Vec<Picture> = pictures.into_iter().flatten().collect();
        let poses: Vec<_> = photos.iter().map(|photo| photo.borrow().camera.pose).collect();
        let neighbors = neighbors(&poses, points, visible);
        let task = |n: usize| Photos { pictures: &pictures, neighbors: &neighbors, points, visible, settings }.photo(n);
        let pass = |before: Option<&[Found]>| {
            let mut found: Vec<Found> = vec![Found::default(); photos.len()];
            parallel::for_chunks(&mut found, 1, |n, to| to[0] = task(n).find(before));
            found
        };
        let first = pass(None);
        let second = pass(Some(&first));
        let near: Vec<&[usize]> = neighbors.iter().map(|near| &near[..near.len().min(WITNESSES)]).collect();
        let maps = agree(&pictures, &second, &near);
        Self { pictures, maps, neighbors, visible: visible.to_vec(), points: points.clone() }
    }

    /// Upper bound in bytes on the memory for the depth of photos of these widths and heights, without the threads' own
    /// memory.
    ///
    /// ```
    /// use weaver_stereo::{Stereo, StereoSettings};
    /// // Twice the photos take twice the memory; their own size does not matter beyond that of finding depth.
    /// let bytes = |count| Stereo::bytes(&vec![[4000, 3000]; count], &StereoSettings::default());
    /// assert_eq!(bytes(60), 2 * bytes(30));
    /// assert_eq!(bytes(1), Stereo::bytes(&[[400, 300]], &StereoSettings::default()));
    /// ```
    pub fn bytes(sizes: &[[usize; 2]], settings: &StereoSettings) -> u64 {
        // Bytes of a pixel: its share of the pictures, and planes and costs of two passes.
        const OF_PIXEL: usize = 3 + 1 + 1 + 2 * 16;
        let picture = |[width, height]: &[usize; 2]| {
            let factor = width.max(height).div_ceil(settings.long_side.clamp(1, LONGEST));
            size_of::<[u32; PIXELS]>() + OF_PIXEL * (width / factor) * (height / factor)
        };
        sizes.iter().map(|size| picture(size) as u64).sum()
    }

    /// The part of each photo whose depth other photos agree about.
    pub fn coverage(&self) -> Vec<f64> {
        let part = |map: &Map| map.w.iter().filter(|w| w.is_finite()).count() as f64 / map.w.len() as f64;
        self.maps.iter().map(part).collect()
    }

    /// Depth along the optical axis for each pixel of a photo, as it was shrunk, `[height, width]`, with its size:
    /// infinite where photos agree that it is, not a number where they do not agree.
    pub fn depth(&self, photo: usize) -> (Vec<f32>, [usize; 2]) {
        let camera = &self.pictures[photo].camera;
        (self.maps[photo].w.iter().map(|w| 1.0 / w).collect(), [camera.height, camera.width])
    }

    /// The points that no map shows.
    pub fn unexplained(&self) -> PointCloud {
        let mut shown = vec![false; self.points.len()];
        for ((picture, map), visible) in self.pictures.iter().zip(&self.maps).zip(&self.visible) {
            for point in visible {
                let n = *point as usize;
                shown[n] |=
                    picture.place(self.points.positions[n]).is_some_and(|(at, w)| (w / map.w[at]).ln().abs() < SHOWN);
            }
        }
        let kept: Vec<usize> = (0..self.points.len()).filter(|n| !shown[*n]).collect();
        PointCloud {
            positions: kept.iter().map(|n| self.points.positions[*n]).collect(),
            colors: kept.iter().map(|n| self.points.colors[*n]).collect(),
        }
    }
}

/// Logarithm of the ratio of depths up to which a map shows a point.
const SHOWN: f32 = 0.03;

impl Picture {
    /// The pixel that shows a point, and its inverse depth.
    pub(crate) fn place(&self, point: [f32; 3]) -> Option<(usize, f32)> {
        let at = self.camera.pose.apply(DVec3::from(point.map(f64::from)));
        let pixel = self.camera.intrinsics.project(at);
        let (width, height) = (self.camera.width, self.camera.height);
        let inside =
            at.z > 0.0 && pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < width as f64 && pixel.y < height as f64;
        inside.then(|| (pixel.y as usize * width + pixel.x as usize, (1.0 / at.z) as f32))
    }
}

struct Photos<'a> {
    pictures: &'a [Picture],
    neighbors: &'a [Vec<usize>],
    points: &'a PointCloud,
    visible: &'a [Vec<u32>],
    settings: &'a StereoSettings,
}

impl<'a> Photos<'a> {
    fn photo(self, photo: usize) -> OnePhoto<'a> {
        OnePhoto { all: self, photo }
    }
}

struct OnePhoto<'a> {
    all: Photos<'a>,
    photo: usize,
}

impl OnePhoto<'_> {
    /// The planes of the photo: from points and chance, or, in the second pass, from the planes that the first found
    /// `before` for all photos.
    fn find(&self, before: Option<&[Found]>) -> Found {
        let Photos { pictures, neighbors, settings, .. } = &self.all;
        let picture = &pictures[self.photo];
        let near = &neighbors[self.photo];
        let near = &near[..near.len().min(settings.sources)];
        let inverse = self.inverse_depths();
        let mut all: Vec<f32> = inverse.iter().map(|(_, w)| *w).collect();
        let ends = [all.len() / 100, all.len().saturating_sub(1) * 99 / 100];
        let [Some(smallest), Some(largest)] = ends.map(|rank| nth(&mut all, rank)) else { return Found::default() };
        if near.is_empty() {
            return Found::default();
        }
        let range = [smallest, largest];
        let source = |other: &usize| Source {
            picture: &pictures[*other],
            there: Warp::new(&picture.camera, &pictures[*other].camera),
            back: Warp::new(&pictures[*other].camera, &picture.camera),
            planes: before.map(|found| found[*other].planes.as_slice()).filter(|planes| !planes.is_empty()),
        };
        let sources: Vec<Source<'_>> = near.iter().map(source).collect();
        let center = picture.camera.pose.center();
        let baseline = |other: &usize| pictures[*other].camera.pose.center().distance(center);
        let baseline = near.iter().map(baseline).sum::<f64>() / near.len() as f64;
        let patches = patches(picture);
        let pass = usize::from(before.is_some());
        let planes = before.map_or_else(|| nearest(&inverse, picture), |found| found[self.photo].planes.clone());
        let mut search = Search {
            most: MARGIN * largest,
            unit: (1.0 / (baseline * picture.camera.intrinsics.fx)) as f32,
            stream: Stream::new(settings.seed, self.photo as u64, "stereo").fork(pass as u64),
            ..Search::new(picture, &patches, &sources, planes)
        };
        let draws = [[0.0, search.most], range, range];
        search.run(Task::Begin { draws: if before.is_none() { &draws } else { &[] } });
        let [size, factor] = SIZES[pass];
        let round = |n: usize| Round {
            number: n as u64,
            size: size * factor.powi(n as i32),
            fresh: before.is_none() && n < FRESH,
        };
        search.run(Task::Rounds(&(0..ROUNDS[pass]).map(round).collect::<Vec<_>>()));
        if before.is_some() {
            search.run(Task::Refine);
        }
        Found { most: search.most, planes: search.planes, costs: search.costs }
    }

    /// The pixels of the points that the photo sees, and their inverse depths.
    fn inverse_depths(&self) -> Vec<(usize, f32)> {
        let picture = &self.all.pictures[self.photo];
        let place = |point: &u32| picture.place(self.all.points.positions[*point as usize]);
        self.all.visible[self.photo].iter().filter_map(place).collect()
    }
}

/// For each pixel the inverse depth of the point that is the fewest steps away.
fn nearest(points: &[(usize, f32)], picture: &Picture) -> Vec<Plane> {
    let (width, height) = (picture.camera.width, picture.camera.height);
    let mut planes = vec![Plane { w: f32::NAN, slope: [0.0; 2] }; width * height];
    let mut queue = VecDeque::new();
    for (at, w) in points {
        // Of several points in a pixel, the nearest hides the others.
        if planes[*at].w.is_nan() {
            queue.push_back(*at);
            planes[*at].w = *w;
        }
        planes[*at].w = planes[*at].w.max(*w);
    }
    while let Some(at) = queue.pop_front() {
        let (x, y) = (at % width, at / width);
        let beside = [(x > 0, at.wrapping_sub(1)), (x + 1 < width, at + 1)];
        let above = [(y > 0, at.wrapping_sub(width)), (y + 1 < height, at + width)];
        for (_, next) in beside.into_iter().chain(above).filter(|(inside, _)| *inside) {
            if planes[next].w.is_nan() {
                planes[next].w = planes[at].w;
                queue.push_back(next);
            }
        }
    }
    planes
}
