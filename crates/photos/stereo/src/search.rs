//! Planes for all pixels of a photo, drawn at random and handed on between neighbors (PatchMatch).

use crate::patch::{Offsets, Patch, dissimilarity};
use crate::picture::Picture;
use crate::warp::Warp;
use weaver_kernels::lanes::{LaneKernel, Lanes};
use weaver_kernels::random::Stream;

/// The plane that a pixel shows: its inverse depth there, and how much that grows for each pixel to the right and down.
/// A plane of the world has an inverse depth that is affine in pixels; at 0 it is infinitely far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Plane {
    pub w: f32,
    pub slope: [f32; 2],
}

impl Plane {
    /// The same plane at a pixel at this offset.
    #[inline(always)]
    fn moved(self, dx: isize, dy: isize) -> Self {
        Self { w: self.w + self.slope[0] * dx as f32 + self.slope[1] * dy as f32, ..self }
    }

    /// The plane through the same place with another slope.
    #[inline(always)]
    fn tilted(self, size: f32, [x, y]: [f32; 2]) -> Self {
        Self { slope: [self.slope[0] + size * x, self.slope[1] + size * y], ..self }
    }
}

/// Planes of a photo and their costs; empty for a photo without neighbors.
#[derive(Clone, Debug, Default)]
pub(crate) struct Found {
    pub planes: Vec<Plane>,
    pub costs: Vec<f32>,
    /// The largest inverse depth that was tried.
    pub most: f32,
}

/// Another photo that shows the same.
#[derive(Debug)]
pub(crate) struct Source<'a> {
    pub picture: &'a Picture,
    /// The way there, and back.
    pub there: Warp,
    pub back: Warp,
    /// The planes found for it before, which those found now should agree with.
    pub planes: Option<&'a [Plane]>,
}

/// The search for the planes of a photo.
#[derive(Debug)]
pub(crate) struct Search<'a> {
    pub picture: &'a Picture,
    pub patches: &'a [Patch],
    pub sources: &'a [Source<'a>],
    /// The largest inverse depth that is tried.
    pub most: f32,
    /// The inverse depth that is worth a pixel between photos.
    pub unit: f32,
    pub stream: Stream,
    pub planes: Vec<Plane>,
    pub costs: Vec<f32>,
    /// The half round in which the plane of each pixel last changed, and in which it last tried its neighbors' planes:
    /// a plane that was refused once is refused again.
    pub history: Vec<[i32; 2]>,
    pub now: i32,
}

/// A round of the search over all pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Round {
    /// Number of the round, which all that is drawn depends on.
    pub number: u64,
    /// Size of the random changes, pixels between photos.
    pub size: f32,
    /// True if inverse depths are also drawn anew.
    pub fresh: bool,
}

/// Cost of a photo that does not show the place.
const OUTSIDE: f32 = 2.0;
/// Cost of a pixel between a place and where the other photo's plane leads back to, and its limit in pixels.
const DISAGREEMENT: f32 = 0.2;
const FARTHEST: f32 = 3.0;
/// Pixels whose planes are tried.
const NEIGHBORS: [[isize; 2]; 8] = [[-1, 0], [1, 0], [0, -1], [0, 1], [-5, 0], [5, 0], [0, -5], [0, 5]];
/// Planes that differ by less, in pixels between photos, are the same.
const SAME: f32 = 0.03;
/// Part of the pixels for which an inverse depth is drawn anew.
const FRESH: f32 = 0.3;
/// The step to both sides from which the best inverse depth is interpolated, pixels between photos.
const STEP: f32 = 0.25;

/// Work on all pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Task<'r> {
    /// Takes the best of the planes that are there and of so many fronto-parallel ones between these inverse depths.
    Begin { draws: &'r [[f32; 2]] },
    /// Rounds of handing on and random changes.
    Rounds(&'r [Round]),
    /// Interpolates inverse depths.
    Refine,
}

impl<'a> Search<'a> {
    /// A search that begins with these planes.
    pub fn new(picture: &'a Picture, patches: &'a [Patch], sources: &'a [Source<'a>], planes: Vec<Plane>) -> Self {
        let pixels = planes.len();
        Self {
            picture,
            patches,
            sources,
            most: 0.0,
            unit: 0.0,
            stream: Stream::new(0, 0, ""),
            planes,
            costs: vec![f32::INFINITY; pixels],
            history: vec![[0, -1]; pixels],
            now: 0,
        }
    }

    /// Does this with all pixels.
    pub fn run(&mut self, task: Task<'_>) {
        weaver_kernels::lanes::run(Sweep(self, task));
    }

    /// The mean cost of the two photos that fit a plane best, or some number not below `limit` if it is not below that.
    #[inline(always)]
    fn cost<V: Lanes<Scalar = f32>>(&self, offsets: &Offsets<V>, at: usize, plane: Plane, limit: f32) -> f32 {
        let width = self.picture.camera.width;
        let pixel = [(at % width) as f32 + 0.5, (at / width) as f32 + 0.5];
        let (mut first, mut second) = (f32::INFINITY, f32::INFINITY);
        for (k, source) in self.sources.iter().enumerate() {
            let cost = cost_in(source, &self.patches[at], offsets, pixel, plane);
            (first, second) = if cost < first { (cost, first) } else { (first, second.min(cost)) };
            // The last photo cannot be better than alike.
            if k + 2 == self.sources.len() && 0.5 * first >= limit {
                return first;
            }
        }
        if second.is_finite() { 0.5 * (first + second) } else { first }
    }

    #[inline(always)]
    fn try_plane<V: Lanes<Scalar = f32>>(&mut self, offsets: &Offsets<V>, at: usize, plane: Plane) {
        if !(0.0..=self.most).contains(&plane.w) {
            return;
        }
        let cost = self.cost(offsets, at, plane, self.costs[at]);
        if cost < self.costs[at] {
            (self.costs[at], self.planes[at]) = (cost, plane);
            self.history[at][0] = self.now;
        }
    }

    /// A number from -1 to 1 for a pixel in a round.
    #[inline(always)]
    fn drawn(&self, round: u64, at: usize, k: u64) -> f32 {
        2.0 * self.stream.fork(round).uniform::<f32>(8 * at as u64 + k) - 1.0
    }

    #[inline(always)]
    fn begin<V: Lanes<Scalar = f32>>(&mut self, offsets: &Offsets<V>, draws: &[[f32; 2]]) {
        for at in 0..self.planes.len() {
            self.costs[at] = self.cost(offsets, at, self.planes[at], f32::INFINITY);
            for (k, [low, high]) in draws.iter().enumerate() {
                let part = 0.5 + 0.5 * self.drawn(u64::MAX, at, k as u64);
                self.try_plane(offsets, at, Plane { w: low + (high - low) * part, slope: [0.0; 2] });
            }
        }
    }

    /// Half of the pixels, one color of a chessboard.
    #[inline(always)]
    fn half<V: Lanes<Scalar = f32>>(&mut self, offsets: &Offsets<V>, round: Round, color: usize) {
        let (width, height) = (self.picture.camera.width, self.picture.camera.height);
        self.now += 1;
        for y in 0..height {
            for x in ((y + color) % 2..width).step_by(2) {
                let at = y * width + x;
                for [dx, dy] in NEIGHBORS {
                    let (nx, ny) = (x as isize + dx, y as isize + dy);
                    if nx < 0 || ny < 0 || nx >= width as isize || ny >= height as isize {
                        continue;
                    }
                    let neighbor = ny as usize * width + nx as usize;
                    let plane = self.planes[neighbor].moved(-dx, -dy);
                    if self.history[neighbor][0] > self.history[at][1] && !self.same(plane, self.planes[at]) {
                        self.try_plane(offsets, at, plane);
                    }
                }
                self.history[at][1] = self.now;
                self.change(offsets, round, at);
            }
        }
    }

    #[inline(always)]
    fn same(&self, a: Plane, b: Plane) -> bool {
        let near = |x: f32, y: f32, far: f32| (x - y).abs() * far < SAME * self.unit;
        near(a.w, b.w, 1.0) && near(a.slope[0], b.slope[0], 4.0) && near(a.slope[1], b.slope[1], 4.0)
    }

    /// Three random changes: of the inverse depth, of the slope, and of both.
    #[inline(always)]
    fn change<V: Lanes<Scalar = f32>>(&mut self, offsets: &Offsets<V>, round: Round, at: usize) {
        let size = round.size * self.unit;
        let mut random = [0.0; 7];
        for (k, random) in random.iter_mut().enumerate() {
            *random = self.drawn(round.number, at, k as u64);
        }
        let now = self.planes[at];
        self.try_plane(offsets, at, Plane { w: now.w + size * random[0], ..now });
        let now = self.planes[at];
        self.try_plane(offsets, at, now.tilted(0.25 * size, [random[1], random[2]]));
        let now = self.planes[at];
        let w = match round.fresh && 0.5 + 0.5 * random[3] < FRESH {
            true => self.most * (0.5 + 0.5 * random[4]),
            false => now.w + 0.3 * size * random[4],
        };
        self.try_plane(offsets, at, Plane { w, ..now.tilted(0.075 * size, [random[5], random[6]]) });
    }

    #[inline(always)]
    fn refine<V: Lanes<Scalar = f32>>(&mut self, offsets: &Offsets<V>) {
        let step = STEP * self.unit;
        for at in 0..self.planes.len() {
            let (plane, middle) = (self.planes[at], self.costs[at]);
            let low = self.cost(offsets, at, Plane { w: plane.w - step, ..plane }, f32::INFINITY);
            let high = self.cost(offsets, at, Plane { w: plane.w + step, ..plane }, f32::INFINITY);
            let curvature = low + high - 2.0 * middle;
            if curvature > 0.0 && low >= middle && high >= middle {
                let w = plane.w + 0.5 * step * (low - high) / curvature;
                self.planes[at].w = w.clamp(0.0, self.most);
            }
        }
    }
}

struct Sweep<'s, 'a, 'r>(&'s mut Search<'a>, Task<'r>);

impl LaneKernel<f32> for Sweep<'_, '_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = f32>>(self) {
        let Self(search, task) = self;
        let offsets = Offsets::<V>::new();
        match task {
            Task::Begin { draws } => search.begin(&offsets, draws),
            // A closure would not be compiled for the instruction set in use, and nothing that it calls.
            Task::Rounds(rounds) => {
                for round in rounds {
                    search.half(&offsets, *round, 0);
                    search.half(&offsets, *round, 1);
                }
            }
            Task::Refine => search.refine(&offsets),
        }
    }
}

/// The cost of a plane in one other photo.
#[inline(always)]
fn cost_in<V: Lanes<Scalar = f32>>(
    source: &Source<'_>,
    patch: &Patch,
    offsets: &Offsets<V>,
    pixel: [f32; 2],
    plane: Plane,
) -> f32 {
    let camera = &source.picture.camera;
    let p = source.there.apply(pixel, plane.w);
    let (x, y) = (p[0] / p[2], p[1] / p[2]);
    let inside = p[2] > 1e-6 && x >= 0.0 && y >= 0.0 && x < camera.width as f32 && y < camera.height as f32;
    if !inside {
        return OUTSIDE;
    }
    let (gx, gy) = (source.there.along(0, plane.slope[0]), source.there.along(1, plane.slope[1]));
    let cost = dissimilarity(patch, offsets, [p, gx, gy], source.picture);
    let Some(planes) = source.planes else { return cost };
    let there = planes[y as usize * camera.width + x as usize];
    let back = source.back.place([x, y], there.w);
    let away = back.map_or(FARTHEST, |([u, v], _)| ((u - pixel[0]).powi(2) + (v - pixel[1]).powi(2)).sqrt());
    cost + DISAGREEMENT * away.min(FARTHEST)
}
