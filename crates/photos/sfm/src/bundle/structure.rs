//! The unknowns, and their connections by observations.

use super::sums::{Coupling, Sums};
use super::{Bundle, Lens};
use std::ops::Range;
use weaver_geometry::glam::DVec3;
use weaver_kernels::parallel;

/// Mark of an item without a number.
pub(super) const NONE: u32 = u32::MAX;
/// Observations below which another part does not pay off, and most parts. Neither depends on the number of threads, so
/// that sums never do.
const OBSERVATIONS: usize = 4096;
const PARTS: usize = 32;

/// The unknowns, in blocks of six: a lens that is adjusted, or the twist of a camera that is. Lenses come first, so
/// that the blocks that they share with cameras belong to the rows of cameras and no row is much longer than the
/// others.
#[derive(Clone, Debug)]
pub(super) struct Blocks {
    /// The block of each camera, or [`NONE`].
    pub of_camera: Vec<u32>,
    /// The block of each lens, or [`NONE`].
    pub of_lens: Vec<u32>,
    /// Number of blocks, and how many of them are of lenses.
    pub count: usize,
    lenses: usize,
}

impl Blocks {
    pub fn new(bundle: &Bundle) -> Self {
        let mut seeing = vec![false; bundle.cameras.len()];
        bundle.observations.iter().for_each(|o| seeing[o.camera] = true);
        let mut used = vec![false; bundle.lenses.len()];
        bundle.lens_of.iter().zip(&seeing).for_each(|(lens, seeing)| used[*lens] |= seeing);
        let mut count = 0;
        let mut number = |takes: bool| {
            count += u32::from(takes);
            if takes { count - 1 } else { NONE }
        };
        let adjusted = |(lens, used): (&Lens, &bool)| {
            lens.free().contains(&true) && (*used || lens.priors().iter().any(|p| p.0 > 0.0))
        };
        let of_lens: Vec<u32> = bundle.lenses.iter().zip(&used).map(|lens| number(adjusted(lens))).collect();
        let expected = |i: usize| bundle.expected.get(i).is_some_and(|(_, weights)| weights.iter().any(|w| *w > 0.0));
        let moves = |i: usize| !bundle.fixed[i] && (bundle.together(i).any(|i| seeing[i]) || expected(i));
        let mut of_camera: Vec<u32> = Vec::with_capacity(seeing.len());
        for i in 0..seeing.len() {
            // The cameras of a rig move as the first one does.
            let first = bundle.mounted(i).on;
            of_camera.push(if first == i { number(moves(i)) } else { of_camera[first] });
        }
        let lenses = of_lens.iter().filter(|b| **b != NONE).count();
        Self { of_camera, of_lens, count: count as usize, lenses }
    }

    /// True if a block is of a camera: lenses come first.
    pub fn is_camera(&self, block: usize) -> bool {
        block >= self.lenses
    }

    /// The blocks of a camera and of its lens.
    fn of(&self, bundle: &Bundle, camera: usize) -> [u32; 2] {
        [self.of_camera[camera], self.of_lens[bundle.lens_of[camera]]]
    }
}

/// An observation of a point by a camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub pixel: [f64; 2],
    /// One over the square of the deviation.
    pub precision: f64,
    pub camera: u32,
    /// Indices of the point and of the camera's sums within the part; [`NONE`] if the camera needs no sums.
    pub point: u32,
    pub sums: u32,
    /// The entries of its point with the camera and with its lens, or [`NONE`].
    pub camera_entry: u32,
    pub lens_entry: u32,
}

/// Some points, with their observations and their part of the equations.
#[derive(Clone, Debug, Default)]
pub(super) struct Part {
    /// Numbers of the points.
    pub numbers: Vec<u32>,
    pub seen: Vec<Seen>,
    /// Start of each point's entries, and the end of the last point's: an entry for every block that the point depends
    /// on, ascending.
    pub first_entry: Vec<u32>,
    /// The block of each entry.
    pub block: Vec<u32>,
    /// Start of each block's list, and the end of the last one's.
    first_of_block: Vec<u32>,
    /// The entries of each block, with their points.
    of_block: Vec<[u32; 2]>,
    pub points: Vec<DVec3>,
    /// The points after the step that is tried.
    pub tried: Vec<DVec3>,
    /// Matrix of each point: xx, xy, xz, yy, yz, zz.
    pub matrix: Vec<[f64; 6]>,
    pub right: Vec<[f64; 3]>,
    /// Inverse of the damped matrix; zero for an undetermined point.
    pub inverse: Vec<[f64; 6]>,
    /// Coupling of each entry with its point.
    pub coupling: Vec<Coupling>,
    /// The cameras of its observations that move or whose lens is adjusted, ascending.
    pub summed: Vec<u32>,
    /// Sums of the observations of each of these and its lens.
    pub sums: Vec<Sums>,
    /// The cost of its observations, of the last pass, and the fall that was predicted.
    pub cost: f64,
    pub predicted: f64,
}

impl Part {
    /// All parts of a bundle. Points that the same cameras see are put side by side, by their first three cameras: work
    /// done camera by camera then finds them near each other.
    pub fn all(bundle: &Bundle, blocks: &Blocks) -> Vec<Self> {
        let observations = &bundle.observations;
        let mut of_point = vec![0..0; bundle.points.len()];
        let mut keys = vec![[u32::MAX; 3]; bundle.points.len()];
        let mut first = 0;
        for seen in observations.chunk_by(|a, b| a.point == b.point) {
            let key = &mut keys[seen[0].point];
            for mut camera in seen.iter().map(|o| o.camera as u32) {
                // Keeps the three smallest numbers, ascending.
                for least in &mut *key {
                    (*least, camera) = (camera.min(*least), camera.max(*least));
                }
            }
            of_point[seen[0].point] = first..first + seen.len();
            first += seen.len();
        }
        let mut order: Vec<u32> = (0..bundle.points.len() as u32).collect();
        order.sort_by_key(|point| keys[*point as usize]);
        let count = (observations.len() / OBSERVATIONS).clamp(1, PARTS);
        let mut parts: Vec<Self> = Vec::with_capacity(count);
        let mut rest = &order[..];
        let mut before = 0;
        for part in 1..=count {
            let enough = part * observations.len() / count;
            let mut end = 0;
            // Parts of about as many observations each, as their work is in observations.
            while end < rest.len() && (before < enough || part == count) {
                before += of_point[rest[end] as usize].len();
                end += 1;
            }
            let (these, others) = rest.split_at(end);
            parts.push(Self { numbers: these.to_vec(), ..Self::default() });
            rest = others;
        }
        parallel::for_chunks(&mut parts, 1, |_, parts| {
            parts.iter_mut().for_each(|part| part.fill(bundle, blocks, &of_point));
        });
        parts
    }

    /// Finds the observations of its points.
    fn fill(&mut self, bundle: &Bundle, blocks: &Blocks, of_point: &[Range<usize>]) {
        let numbers = std::mem::take(&mut self.numbers);
        let all = || numbers.iter().map(|point| &bundle.observations[of_point[*point as usize].clone()]);
        let part = self;
        part.points = numbers.iter().map(|point| bundle.points[*point as usize]).collect();
        part.seen = Vec::with_capacity(all().map(|seen| seen.len()).sum());
        let mut sums = vec![NONE; bundle.cameras.len()];
        for o in all().flatten() {
            if blocks.of(bundle, o.camera) != [NONE; 2] && sums[o.camera] == NONE {
                sums[o.camera] = 0;
                part.summed.push(o.camera as u32);
            }
        }
        part.summed.sort_unstable();
        part.summed.iter().enumerate().for_each(|(number, camera)| sums[*camera as usize] = number as u32);
        let mut of_point: Vec<u32> = Vec::new();
        for (point, here) in all().enumerate() {
            let first = part.block.len();
            part.first_entry.push(first as u32);
            of_point.clear();
            if !bundle.fixed_points {
                of_point.extend(here.iter().flat_map(|o| blocks.of(bundle, o.camera)).filter(|b| *b != NONE));
                of_point.sort_unstable();
                of_point.dedup();
            }
            let entry = |block: u32| of_point.binary_search(&block).map_or(NONE, |at| (first + at) as u32);
            part.seen.extend(here.iter().map(|o| {
                let [camera_entry, lens_entry] = blocks.of(bundle, o.camera).map(entry);
                let pixel = o.pixel.to_array();
                let precision = 1.0 / (o.deviation * o.deviation);
                let (camera, point, sums) = (o.camera as u32, point as u32, sums[o.camera]);
                Seen { pixel, precision, camera, point, sums, camera_entry, lens_entry }
            }));
            part.block.extend_from_slice(&of_point);
        }
        part.first_entry.push(part.block.len() as u32);
        part.list(blocks.count);
        let held = if bundle.fixed_points { 0 } else { numbers.len() };
        part.tried = part.points[..held].to_vec();
        part.matrix = vec![[0.0; 6]; held];
        part.right = vec![[0.0; 3]; held];
        part.inverse = vec![[0.0; 6]; held];
        part.coupling = vec![Coupling::default(); part.block.len()];
        part.sums = vec![Sums::default(); part.summed.len()];
        part.numbers = numbers;
    }

    /// Lists the entries by block.
    fn list(&mut self, blocks: usize) {
        let mut next = vec![0; blocks + 1];
        self.block.iter().for_each(|b| next[*b as usize + 1] += 1);
        for b in 0..blocks {
            next[b + 1] += next[b];
        }
        self.first_of_block = next.clone();
        self.of_block = vec![[0; 2]; self.block.len()];
        for point in 0..self.points.len() {
            for entry in self.entries(point) {
                let at = &mut next[self.block[entry] as usize];
                self.of_block[*at as usize] = [entry as u32, point as u32];
                *at += 1;
            }
        }
    }

    /// The entries of a point.
    #[inline(always)]
    pub fn entries(&self, point: usize) -> Range<usize> {
        self.first_entry[point] as usize..self.first_entry[point + 1] as usize
    }

    /// The entries of a block, each with its point.
    #[inline(always)]
    pub fn of_block(&self, block: usize) -> &[[u32; 2]] {
        &self.of_block[self.first_of_block[block] as usize..self.first_of_block[block + 1] as usize]
    }
}
