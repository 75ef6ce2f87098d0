//! A wall and four groups of moving Gaussians, seven cameras, and four experts, each for one way to move.

use super::family::Family;
use super::frames::{FRAMES, seen, time};
use weaver_autograd::Tape;
use weaver_dynamic::Shot;
use weaver_kernels::random::Stream;
use weaver_pose::CameraVars;
use weaver_splat::{GaussianVars, RasterSettings, WorkspacePool};

pub const CAMERAS: usize = 7;
pub const HELD_OUT: usize = CAMERAS / 2;
pub const EXPERTS: [&str; 4] = ["Poly", "Keys", "Code", "Field"];
pub const SIZE: [usize; 2] = [48, 64];
pub const PIXELS: usize = SIZE[0] * SIZE[1];

/// Gaussians of a group, their size, and the amplitude of their motion, which reproduces the first study's figures of
/// experts and their mean.
const GROUP: usize = 60;
const RADIUS: f64 = 0.05;
const AMPLITUDE: f64 = 0.07;
/// In front of the wall, which is at depth 0; cameras are at negative depths.
const DEPTH: f64 = -0.5;
/// Reach of a field.
const REACH: f64 = 0.1;
/// The pulse: its width, and its way over the clip, along the first axis.
const PULSE: [f64; 2] = [0.2, 2.5];

/// Layout of the groups.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Layout {
    /// Each in a corner of the picture: the position of a pixel determines its expert.
    Corners,
    /// Each in two of eight patches, between patches of others.
    Patches,
}

/// The drawn world, by frames.
pub struct World {
    /// True centers `[F][N, 3]`.
    truth: Vec<Vec<f64>>,
    /// The experts' centers `[F][K N, 3]`, one expert after the other.
    experts: Vec<Vec<f64>>,
    radii: Vec<f64>,
    opacities: Vec<f64>,
    colors: Vec<f64>,
    workspaces: WorkspacePool<f32>,
}

impl World {
    pub fn new(seed: u64, layout: Layout) -> Self {
        let stream = |purpose: &str| Stream::new(seed, 0, purpose);
        let (mut truth, mut radii, mut opacities, mut colors) = (vec![Vec::new(); FRAMES], vec![], vec![], vec![]);
        let shades = stream("colors");
        for (row, column) in (0..17).flat_map(|row| (0..31).map(move |column| (row, column))) {
            let place = [0.15 * f64::from(column - 15), 0.15 * f64::from(row - 8), 0.0];
            truth.iter_mut().for_each(|frame| frame.extend(place));
            radii.push(0.1);
            opacities.push(0.99);
        }
        for group in 0..EXPERTS.len() {
            for i in 0..GROUP {
                let own = stream("paths").fork((group * GROUP + i) as u64);
                let (middle, half) = layout.patch(group, i);
                let base =
                    [0, 1, 2].map(|axis| middle[axis] + half[axis] * (2.0 * own.uniform::<f64>(axis as u64) - 1.0));
                for (frame, to) in truth.iter_mut().enumerate() {
                    to.extend(path(group, (base, middle), own, time(frame)));
                }
                radii.push(RADIUS);
                opacities.push(0.95);
            }
        }
        (0..3 * radii.len()).for_each(|i| colors.push(shades.uniform::<f64>(i as u64)));
        let experts = experts(&truth);
        Self { truth, experts, radii, opacities, colors, workspaces: WorkspacePool::new() }
    }

    /// Gaussians of an expert.
    pub fn count(&self) -> usize {
        self.radii.len()
    }

    /// Owner of each Gaussian of the list.
    pub fn owners(&self) -> Vec<usize> {
        (0..EXPERTS.len() * self.count()).map(|i| i / self.count()).collect()
    }

    /// Distance of an expert's Gaussians of a group from the truth: root of the mean square over all frames.
    pub fn distance(&self, expert: usize, group: usize) -> f64 {
        let n = self.count();
        let from = n - (EXPERTS.len() - group) * GROUP;
        let squares = self.truth.iter().zip(&self.experts).map(|(truth, experts)| {
            let own = &experts[3 * (expert * n + from)..][..3 * GROUP];
            own.iter().zip(&truth[3 * from..]).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / GROUP as f64
        });
        (squares.sum::<f64>() / FRAMES as f64).sqrt()
    }

    pub fn true_gaussians<'t>(&self, tape: &'t Tape<f32>, frame: usize) -> GaussianVars<'t, f32> {
        self.gaussians(tape, &self.truth[frame])
    }

    /// The list of all experts' Gaussians.
    pub fn expert_gaussians<'t>(&self, tape: &'t Tape<f32>, frame: usize) -> GaussianVars<'t, f32> {
        self.gaussians(tape, &self.experts[frame])
    }

    fn gaussians<'t>(&self, tape: &'t Tape<f32>, means: &[f64]) -> GaussianVars<'t, f32> {
        let n = means.len() / 3;
        let of = |width: usize, value: &dyn Fn(usize) -> f64| {
            tape.constant_with([n, width], |all| (0..n * width).for_each(|i| all[i] = value(i) as f32))
        };
        let own = self.count();
        GaussianVars {
            means: of(3, &|i| means[i]),
            quats: of(4, &|i| if i % 4 == 0 { 1.0 } else { 0.0 }),
            scales: of(3, &|i| self.radii[i / 3 % own]),
            opacities: of(1, &|i| self.opacities[i % own]).reshape([n]),
            colors: of(3, &|i| self.colors[i % (3 * own)]),
        }
    }

    /// A camera of the arc, which looks at the groups, at a frame.
    pub fn shot<'a, 't>(&'a self, tape: &'t Tape<f32>, camera: usize, frame: usize) -> Shot<'a, 't, f32> {
        let angle = (10.0 * camera as f64 - 30.0_f64).to_radians();
        let (sin, cos) = angle.sin_cos();
        // World to camera: turned about the vertical through the middle of the groups, which is 2.5 ahead.
        let view = [cos, 0.0, sin, -sin * DEPTH, 0.0, 1.0, 0.0, 0.0, -sin, 0.0, cos, 2.5 - cos * DEPTH];
        let lens = [80.0, 80.0, SIZE[1] as f64 / 2.0, SIZE[0] as f64 / 2.0];
        let numbers = |values: &[f64]| values.iter().map(|x| *x as f32).collect::<Vec<_>>();
        Shot {
            camera: CameraVars {
                viewmats: tape.constant(&numbers(&view), [1, 3, 4]),
                intrinsics: tape.constant(&numbers(&lens), [1, 4]),
            },
            time: time(frame),
            size: SIZE,
            background: tape.constant(&[0.0; 3], [3]),
            settings: RasterSettings::default(),
            workspaces: &self.workspaces,
        }
    }
}

impl Layout {
    /// The middle and half the size of the box of a Gaussian's initial position.
    fn patch(self, group: usize, i: usize) -> ([f64; 3], [f64; 3]) {
        match self {
            Self::Corners => {
                let middle =
                    [if group.is_multiple_of(2) { -0.42 } else { 0.42 }, if group < 2 { -0.3 } else { 0.3 }, DEPTH];
                (middle, [0.36, 0.24, 0.1])
            }
            Self::Patches => {
                let row = i % 2;
                let column = (group + 2 * row) % 4;
                ([0.45 * column as f64 - 0.675, 0.6 * row as f64 - 0.3, DEPTH], [0.17, 0.24, 0.1])
            }
        }
    }
}

/// Position of a Gaussian of a group that begins at `base`; random numbers differ between Gaussians.
fn path(group: usize, (base, middle): ([f64; 3], [f64; 3]), own: Stream, t: f64) -> [f64; 3] {
    let random = |axis: usize, i: usize| {
        let depth = if axis == 2 { 0.3 } else { 1.0 };
        AMPLITUDE * depth * own.fork(1).normal::<f64>((8 * axis + i) as u64)
    };
    let shift = |axis: usize| match EXPERTS[group] {
        "Field" => {
            // Neighbors move alike: only then is there a field.
            let along = base[0] - (middle[0] - 1.0 + PULSE[1] * t);
            let height = if axis == 1 { 2.0 * AMPLITUDE } else { 0.0 };
            height * (-(along / PULSE[0]).powi(2)).exp()
        }
        name => Family::named(name).basis(t).iter().enumerate().map(|(i, b)| random(axis, i) * b).sum(),
    };
    [0, 1, 2].map(|axis| base[axis] + shift(axis))
}

/// Experts fitted to true paths `[F][N, 3]`.
fn experts(truth: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut all = vec![Vec::new(); truth.len()];
    for name in EXPERTS {
        let own = if name == "Field" { smoothed(truth) } else { Family::named(name).fitted(truth) };
        all.iter_mut().zip(own).for_each(|(all, own)| all.extend(own));
    }
    all
}

/// Displaces each Gaussian from its mean position by the weighted mean displacement of its neighbors in the first
/// frame.
fn smoothed(truth: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let first = &truth[0];
    let weights: Vec<Vec<(usize, f64)>> = first
        .chunks(3)
        .map(|a| {
            let weight = |b: &[f64]| {
                let squared: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
                (-squared / (2.0 * REACH * REACH)).exp()
            };
            let near = first.chunks(3).map(weight).enumerate().filter(|(_, weight)| *weight > 1e-9);
            let near: Vec<_> = near.collect();
            let sum: f64 = near.iter().map(|(_, weight)| weight).sum();
            near.into_iter().map(|(j, weight)| (j, weight / sum)).collect()
        })
        .collect();
    let count = (0..FRAMES).filter(|frame| seen(*frame)).count() as f64;
    let mean = |i: usize| (0..FRAMES).filter(|frame| seen(*frame)).map(|frame| truth[frame][i]).sum::<f64>() / count;
    let means: Vec<f64> = (0..first.len()).map(mean).collect();
    let moved = |frame: &Vec<f64>| {
        let shift = |(i, to): (usize, &f64)| {
            let of = |(j, weight): &(usize, f64)| weight * (frame[3 * j + i % 3] - means[3 * j + i % 3]);
            to + weights[i / 3].iter().map(of).sum::<f64>()
        };
        means.iter().enumerate().map(shift).collect()
    };
    truth.iter().map(moved).collect()
}
