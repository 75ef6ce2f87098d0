//! E-D3DGS (Bae et al., ECCV 2024, arXiv 2404.03613): each Gaussian has a code, and so has each moment.

use super::heads::OffsetHeads;
use super::{Motion, Moved, RawGaussians, Start};
use weaver_autograd::{ParamId, Real, Var};
use weaver_kernels::nearest_neighbors::nearest_neighbors;
use weaver_nn::{Builder, Context, Init};

/// Initial deviation of the codes of moments, over the deviation of Gaussians' codes: N(0, 0.01 / 16).
const MOMENTS: f64 = 0.01 / 16.0;
/// Weight of the mean opacity.
const OPAQUE: f64 = 1e-4;
/// Decay of a neighbor's weight with the squared distance.
const FALL_OFF: f64 = 2000.0;
/// Keeps the root of 0 away from its pole.
const TINY: f64 = 1e-20;

/// Sizes of a [`Code`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CodeConfig {
    /// Numbers of a Gaussian's code: 32 as published.
    pub code: usize,
    /// Moments of the table, and numbers of each: 150 and 256 as published.
    pub table: [usize; 2],
    /// Moments in the inputs of the coarse and the fine net, at least 2 each; the table is resampled to these numbers.
    pub moments: [usize; 2],
    /// Hidden width: 128 as published.
    pub width: usize,
    /// Neighbors whose codes are kept alike: 20 as published.
    pub neighbors: usize,
}

/// Offsets by a coarse and a fine net of [code of the moment ; code of the Gaussian]: no position enters, so that
/// neighbors can move against each other.
#[derive(Clone, Debug)]
pub struct Code {
    config: CodeConfig,
    raw: RawGaussians,
    z: ParamId,
    table: ParamId,
    nets: [OffsetHeads; 2],
    /// Indices of neighbors `[N, neighbors]`, by initial positions.
    neighbors: Vec<u32>,
}

impl Code {
    /// Builds the raw Gaussians, `z` `[N, code]`, `table`, `coarse` and `fine`, without motion at first.
    ///
    /// # Panics
    /// Unless there are more Gaussians than neighbors and at least two moments each.
    pub fn new<T: Real>(mut b: Builder<'_, T>, start: &Start<'_>, config: CodeConfig) -> Self {
        let CodeConfig { code, table: [rows, width], moments, neighbors, .. } = config;
        let n = start.count();
        assert!(n > neighbors, "more Gaussians than {neighbors} neighbors");
        assert!(rows > 1 && moments.iter().all(|moments| *moments > 1), "at least two moments");
        let raw = RawGaussians::new(&mut b, start);
        let z = b.add("z", [n, code], Init::Constant(0.0));
        let table = b.add("table", [rows, width], Init::Normal(MOMENTS));
        let inputs = width + code;
        let nets = ["coarse", "fine"].map(|name| OffsetHeads::new(&mut b.scope(name), inputs, config.width));
        Self { config, raw, z, table, nets, neighbors: nearest(start.positions, neighbors) }
    }

    /// The mean, over Gaussians and their neighbors, of sqrt(exp(-2000 d^2) |z_i - z_j|^2 + 1e-20), where d is the
    /// distance of their raw means, which is held constant.
    pub fn smoothness<'t, T: Real>(&self, cx: Context<'t, '_, T>) -> Var<'t, T> {
        let (z, k) = (cx.param(self.z), self.config.neighbors);
        let [n, width] = [0, 1].map(|axis| z.shape()[axis]);
        let means: Vec<f64> = cx.param(self.raw.mean()).value().iter().map(|x| x.to_f64()).collect();
        let pairs = self.neighbors.iter().enumerate().map(|(i, j)| (i / k.max(1), *j as usize));
        let weights: Vec<T> = pairs
            .map(|(i, j)| (0..3).map(|axis| (means[3 * i + axis] - means[3 * j + axis]).powi(2)).sum::<f64>())
            .map(|squared| T::from_f64((-FALL_OFF * squared).exp()))
            .collect();
        let own = z.reshape([n, 1, width]).expand([n, k, width]).reshape([n * k, width]);
        let apart = (own - z.gather_rows(&self.neighbors)).square().sum_axis(1);
        (apart * cx.tape.constant(&weights, [n * k]) + TINY).sqrt().mean()
    }

    /// The code of a moment `[1, width]`: the table resampled to `moments` rows, then sampled between two of these;
    /// both are linear.
    fn moment<'t, T: Real>(&self, cx: Context<'t, '_, T>, time: f64, moments: usize) -> Var<'t, T> {
        let rows = self.config.table[0];
        // Index of the interval among `count` samples, and the place within it.
        let between = |x: f64, count: usize| {
            let first = (x.max(0.0) as usize).min(count - 2);
            [(first, 1.0 - (x - first as f64)), (first + 1, x - first as f64)]
        };
        let mut weights = vec![T::ZERO; rows];
        for (moment, share) in between(time * (moments - 1) as f64, moments) {
            let place = moment as f64 / (moments - 1) as f64 * (rows - 1) as f64;
            for (row, part) in between(place, rows) {
                weights[row] += T::from_f64(share * part);
            }
        }
        cx.tape.constant(&weights, [1, rows]).matmul(cx.param(self.table))
    }
}

impl<T: Real> Motion<T> for Code {
    fn rows(&self) -> Vec<ParamId> {
        [self.raw.ids(), vec![self.z]].concat()
    }

    fn at<'t>(&self, cx: Context<'t, '_, T>, time: f64) -> Moved<'t, T> {
        let z = cx.param(self.z);
        let n = z.shape()[0];
        let nets = self.nets.iter().zip(self.config.moments);
        let raw = nets.fold(self.raw.vars(cx), |raw, (net, moments)| {
            let moment = self.moment(cx, time, moments).expand([n, self.config.table[1]]);
            net.added(cx, weaver_autograd::ops::concat(&[moment, z], 1), raw)
        });
        Moved::activated(raw)
    }

    /// 1e-4 times the mean opacity, plus the [smoothness](Code::smoothness) of codes.
    fn regularizer<'t>(&self, cx: Context<'t, '_, T>) -> Option<Var<'t, T>> {
        let [.., opacity] = self.raw.vars(cx);
        Some(opacity.sigmoid().mean() * OPAQUE + self.smoothness(cx))
    }
}

/// The nearest others of each of N points `[N, 3]`: `[N, k]`.
fn nearest(positions: &[f64], k: usize) -> Vec<u32> {
    let mut rows = vec![0; positions.len() / 3 * (k + 1)];
    nearest_neighbors(positions, k, &mut rows);
    // Each row begins with the point itself.
    rows.chunks_exact(k + 1).flat_map(|row| row[1..].iter().copied()).collect()
}
