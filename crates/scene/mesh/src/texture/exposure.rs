//! Gains that bring the colors of photos together.

use super::sight::Sight;
use super::weights::Weights;
use crate::Mesh;
use rayon::prelude::*;
use weaver_geometry::glam::DVec3;
use weaver_kernels::dense::{cholesky, cholesky_solve};

/// The most vertices that are compared.
const MOST: usize = 50_000;
/// Colors beyond which a photo is black or burnt out.
const DARK: f64 = 8.0;
const BRIGHT: f64 = 247.0;
/// Difference of logarithms from which on a color counts less: a reflection, or something that moved.
const OFF: f64 = 0.1;
/// Rounds in which these are found.
const ROUNDS: usize = 5;
/// Weight, over the mean one of a photo, that holds gains at 1.
const HELD: f64 = 1e-4;

/// A comparison of two photos: which, and the logarithms of the second's colors over the first's.
type Pair = (usize, usize, DVec3);

/// The factor of each photo's colors: the least squares of differences of logarithms at the vertices that several see,
/// with weights 1 / (1 + (r / 0.1)^2); their product is about 1.
pub fn gains(mesh: &Mesh, weights: &Weights, sights: &[Sight<'_>]) -> Vec<DVec3> {
    let step = mesh.vertices.len().div_ceil(MOST).max(1);
    let of_vertex = |v: usize| {
        let point = DVec3::from_array(mesh.vertices[v].map(f64::from));
        let logarithm = |(view, _): &(u32, f32)| {
            let color = sights[*view as usize].mean(point);
            let usable = color.min_element() > DARK && color.max_element() < BRIGHT;
            usable.then(|| (*view as usize, DVec3::from_array(color.to_array().map(f64::ln))))
        };
        let seen: Vec<(usize, DVec3)> = weights.of(v).iter().filter_map(logarithm).collect();
        let mut pairs: Vec<Pair> = Vec::new();
        for (i, (a, first)) in seen.iter().enumerate() {
            pairs.extend(seen[i + 1..].iter().map(|(b, second)| (*a, *b, *second - *first)));
        }
        pairs
    };
    let vertices: Vec<usize> = (0..mesh.vertices.len()).step_by(step).collect();
    let pairs: Vec<Pair> = vertices.par_iter().map(|v| of_vertex(*v)).collect::<Vec<_>>().concat();
    let solved: Vec<Vec<f64>> =
        (0..3).into_par_iter().map(|channel| logarithms(&pairs, sights.len(), channel)).collect();
    (0..sights.len())
        .map(|view| DVec3::new(solved[0][view].exp(), solved[1][view].exp(), solved[2][view].exp()))
        .collect()
}

/// The logarithms of the gains of one channel.
fn logarithms(pairs: &[Pair], views: usize, channel: usize) -> Vec<f64> {
    let mut gains = vec![0.0; views];
    if pairs.is_empty() {
        return gains;
    }
    for round in 0..ROUNDS {
        let mut matrix = vec![0.0; views * views];
        let mut right = vec![0.0; views];
        for (a, b, difference) in pairs {
            let rest = difference[channel] + gains[*b] - gains[*a];
            let weight = if round == 0 { 1.0 } else { 1.0 / (1.0 + (rest / OFF).powi(2)) };
            for (i, k) in [(*a, *b), (*b, *a)] {
                matrix[i * views + i] += weight;
                matrix[i * views + k] -= weight;
            }
            right[*a] += weight * difference[channel];
            right[*b] -= weight * difference[channel];
        }
        let held = HELD * (0..views).map(|i| matrix[i * views + i]).sum::<f64>() / views as f64;
        (0..views).for_each(|i| matrix[i * views + i] += held);
        if !cholesky(&mut matrix, views, views) {
            return gains;
        }
        cholesky_solve(&matrix, &mut right);
        gains = right;
    }
    gains
}
