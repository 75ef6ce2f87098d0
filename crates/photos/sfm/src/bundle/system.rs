//! The part of the normal equations for cameras and lenses alone.

#![expect(clippy::needless_range_loop, reason = "numbers in registers go side by side through several arrays")]

use super::lens::{Lens, NUMBERS};
use super::structure::{Blocks, NONE, Part};
use super::sums::{BLOCK, PADDED, Sums};
use super::{Bundle, TWIST};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Pose, se3};

/// A block of a matrix, its rows filled up with zeros.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(64))]
pub(super) struct Block(pub [[f64; PADDED]; BLOCK]);

/// Numbers of a block.
pub(super) type Row = [f64; PADDED];

/// Place of the residual in the sums of a camera: last, in rows with a lens and without.
const WITH_LENS: usize = 11;
const ALONE: usize = 7;

/// Matrix and right side of cameras and lenses, before the points are eliminated.
#[derive(Clone, Debug)]
pub(super) struct System {
    /// Diagonal blocks.
    pub matrix: Vec<Block>,
    /// The block of each camera with its lens.
    pub with_lens: Vec<Block>,
    /// The block of the lens of each, or [`NONE`].
    pub lens: Vec<u32>,
    pub right: Vec<Row>,
    /// The diagonal; 1 for an unknown without observations, so that it stays.
    pub diagonal: Vec<Row>,
    /// Of each camera.
    sums: Vec<Sums>,
}

impl System {
    pub fn new(bundle: &Bundle, blocks: &Blocks) -> Self {
        let n = blocks.count;
        let mut lens = vec![NONE; n];
        for (camera, block) in blocks.of_camera.iter().enumerate().filter(|(_, block)| **block != NONE) {
            lens[*block as usize] = blocks.of_lens[bundle.lens_of[camera]];
        }
        Self {
            matrix: vec![Block::default(); n],
            with_lens: vec![Block::default(); n],
            lens,
            right: vec![[0.0; PADDED]; n],
            diagonal: vec![[1.0; PADDED]; n],
            sums: vec![Sums::default(); bundle.cameras.len()],
        }
    }

    /// Adds up observations and priors.
    pub fn sum(&mut self, bundle: &Bundle, blocks: &Blocks, parts: &[Part], poses: &[Pose], lenses: &[Lens]) {
        self.matrix.fill(Block::default());
        self.with_lens.fill(Block::default());
        self.right.fill([0.0; PADDED]);
        self.sums.fill(Sums::default());
        for part in parts {
            part.summed.iter().zip(&part.sums).for_each(|(camera, sums)| self.sums[*camera as usize].add(sums));
        }
        for camera in 0..self.sums.len() {
            self.of_camera(camera, blocks.of_camera[camera], blocks.of_lens[bundle.lens_of[camera]]);
        }
        for (lens, block) in lenses.iter().zip(&blocks.of_lens).filter(|(_, block)| **block != NONE) {
            for (i, (weight, off)) in lens.priors().into_iter().enumerate() {
                self.matrix[*block as usize].0[i][i] += weight;
                self.right[*block as usize][i] -= weight * off;
            }
        }
        for (camera, (pose, expected)) in poses.iter().zip(&bundle.expected).enumerate() {
            let block = blocks.of_camera[camera];
            if block != NONE && bundle.leads(camera) {
                self.expect(block as usize, pose, expected);
            }
        }
        for (diagonal, matrix) in self.diagonal.iter_mut().zip(&self.matrix) {
            *diagonal = std::array::from_fn(|i| match matrix.0.get(i).map(|row| row[i]) {
                Some(x) if x > 0.0 => x,
                _ => 1.0,
            });
        }
    }

    fn of_camera(&mut self, number: usize, camera: u32, lens: u32) {
        let sums = &self.sums[number];
        let last = if lens == NONE { ALONE } else { WITH_LENS };
        if camera != NONE {
            let camera = camera as usize;
            for a in 0..BLOCK {
                (0..BLOCK).for_each(|b| self.matrix[camera].0[a][b] += sums.at(a, b));
                self.right[camera][a] -= sums.at(last, a);
                if lens != NONE {
                    (0..NUMBERS).for_each(|b| self.with_lens[camera].0[a][b] += sums.at(a, BLOCK + b));
                }
            }
        }
        if lens != NONE {
            let lens = lens as usize;
            for a in 0..NUMBERS {
                (0..NUMBERS).for_each(|b| self.matrix[lens].0[a][b] += sums.at(BLOCK + a, BLOCK + b));
                self.right[lens][a] -= sums.at(last, BLOCK + a);
            }
        }
    }

    /// Adds the prior on a camera's twist from its expected pose.
    fn expect(&mut self, block: usize, pose: &Pose, (expected, weights): &(Pose, [f64; TWIST])) {
        let twist = apart(pose, expected);
        let by = by_movement(&twist);
        for a in 0..BLOCK {
            for k in 0..TWIST {
                let x = weights[k] * by[k][a];
                (0..BLOCK).for_each(|b| self.matrix[block].0[a][b] += x * by[k][b]);
                self.right[block][a] -= x * twist[k];
            }
        }
    }
}

/// Cost of priors.
pub(super) fn expectations(bundle: &Bundle, blocks: &Blocks, poses: &[Pose], lenses: &[Lens]) -> f64 {
    let lenses = lenses.iter().zip(&blocks.of_lens).filter(|(_, block)| **block != NONE);
    let of_lenses: f64 = lenses.flat_map(|(lens, _)| lens.priors()).map(|(weight, off)| weight * off * off).sum();
    let moves = |camera: &usize| blocks.of_camera[*camera] != NONE && bundle.leads(*camera);
    let cameras = (0..bundle.expected.len()).filter(moves);
    let of_camera = |camera: usize| -> f64 {
        let (expected, weights) = &bundle.expected[camera];
        apart(&poses[camera], expected).iter().zip(weights).map(|(x, weight)| weight * x * x).sum()
    };
    of_lenses + cameras.map(of_camera).sum::<f64>()
}

/// The twist from one pose to another.
fn apart(pose: &Pose, from: &Pose) -> [f64; TWIST] {
    let (v, w) = se3::log(&pose.relative_to(from));
    [v.x, v.y, v.z, w.x, w.y, w.z]
}

/// The derivative of the twist `x` of a pose by a twist that moves the pose: the inverse of the left Jacobian of SE(3),
/// with `ad` the adjoint of x the sum of `B_n ad^n / n!` over Bernoulli's numbers B_n. Up to a rotation by 1 radian,
/// the truncation error is below 1e-9.
///
/// Source: Barfoot, "State Estimation for Robotics", chapter 7.
fn by_movement(x: &[f64; TWIST]) -> [[f64; TWIST]; TWIST] {
    const TERMS: [f64; 10] = {
        let [two, four, six, eight, ten] =
            [1.0 / 12.0, -1.0 / 720.0, 1.0 / 30240.0, -1.0 / 1_209_600.0, 1.0 / 47_900_160.0];
        [-0.5, two, 0.0, four, 0.0, six, 0.0, eight, 0.0, ten]
    };
    let (v, w) = (DVec3::new(x[0], x[1], x[2]), DVec3::new(x[3], x[4], x[5]));
    let mut derivative = [[0.0; TWIST]; TWIST];
    for column in 0..TWIST {
        // ad (a, b) = (w x a + v x b, w x b).
        let unit = |k: usize| DVec3::from_array(std::array::from_fn(|i| f64::from(k + i == column)));
        let (mut a, mut b) = (unit(0), unit(3));
        let (mut head, mut turn) = (a, b);
        for term in TERMS {
            (a, b) = (w.cross(a) + v.cross(b), w.cross(b));
            head += a * term;
            turn += b * term;
        }
        for (row, x) in head.to_array().into_iter().chain(turn.to_array()).enumerate() {
            derivative[row][column] = x;
        }
    }
    derivative
}
