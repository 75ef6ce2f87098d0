//! Ex4DGS (Lee et al., NeurIPS 2024, arXiv 2410.15629): keys in time, between which positions and rotations are
//! interpolated.

use super::{Motion, Moved, RawGaussians, Start, logit};
use weaver_autograd::{ParamId, Real, Var, apply_pointwise, pointwise};
use weaver_nn::{Builder, Context, Init};

/// Initial log of the width of an opacity's flanks, in keys.
const WIDTH: f64 = 1.0;
/// Upper bound on the cosine between neighboring rotations, for a finite derivative of the angle.
const NEAREST: f64 = 1.0 - 1e-4;
/// Width of a flank at half its height, in deviations: 2 sqrt(2 ln 2).
const HALF: f64 = 2.36;
/// Weights of the regularizer of static Gaussians and of moving ones, and the addend of a length before its logarithm.
const STILL: f64 = 1e-4;
const NEAR: f64 = 1e-3;

pointwise!(
    /// The share of the first of two unit quaternions with the dot product `dot`, 0 or more, at `part` of the way to
    /// the second.
    SlerpShare { part: f64 }, 1, |dot| {
        let dot = dot.min(NEAREST);
        // acos without its pole: twice the arctangent of the half angle's.
        let angle = ((1.0 - dot) / (1.0 + dot)).sqrt().atan() * 2.0;
        let first = (angle * (1.0 - part)).sin();
        let second = (angle * part).sin();
        first / (first + second)
    }
);

pointwise!(
    /// exp(-(d / (e^v + margin))^2): opacity at a distance d outside the window whose flank has the log width v.
    Flank { margin: f64 }, 2, |d, v| {
        let x = d / (v.exp() + margin);
        (-x * x).exp()
    }
);

/// Timing of keys.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeysConfig {
    /// Frames of the clip, at least 1.
    pub frames: usize,
    /// Frames between two keys, at least 1: 10 as published.
    pub interval: usize,
    /// Frames before the first one.
    pub pad: f64,
    /// Least width of the opacities' flanks, frames.
    pub margin: f64,
}

impl KeysConfig {
    /// The key before a frame, and the distance of the frame from it, in keys.
    fn place(&self, frame: f64) -> (usize, f64) {
        let x = (frame + self.pad) / self.interval as f64;
        (x as usize, x - x.floor())
    }

    /// Keys of a Gaussian: one before the first, and two after the last one within the clip.
    fn count(&self) -> usize {
        self.place(self.frames as f64).0 + 4
    }
}

/// Keys every I frames: with x = (frame + pad) / I, n = floor x and d = x - n, the mean is the cubic Hermite spline
/// through the keys n and n + 1 with slopes (p_{n+1} - p_{n-1}) / 2, the quaternion goes the shorter way around, by
/// angles, and the opacity is full between two times and falls off as exp(-(m / (e^v + margin / (2.36 I)))^2) outside,
/// m keys away from the nearer.
#[derive(Clone, Copy, Debug)]
pub struct Keys {
    config: KeysConfig,
    position: ParamId,
    quat: ParamId,
    scale: ParamId,
    opacity: ParamId,
    center: ParamId,
    width: ParamId,
}

impl Keys {
    /// Builds `position` `[N, J, 3]`, `quat` `[N, J, 4]`, `scale` `[N, 3]`, `opacity` `[N, 1]`, `center` `[N, 2]` and
    /// `width` `[N, 2]`, at first without motion and visible all the time.
    ///
    /// # Panics
    /// Unless there are three coordinates for each size, and an interval of at least one frame.
    pub fn new<T: Real>(mut b: Builder<'_, T>, start: &Start<'_>, config: KeysConfig) -> Self {
        let (n, keys) = (start.count(), config.count());
        assert_eq!(start.positions.len(), 3 * n, "three coordinates for each of {n} sizes");
        assert!(config.interval > 0, "keys are at least a frame apart");
        let last = config.place(config.frames as f64);
        let ends = [0.0, last.0 as f64 + last.1];
        let position = b.add("position", [n, keys, 3], Init::Constant(0.0));
        let quat = b.add("quat", [n, keys, 4], Init::Constant(0.0));
        let scale = b.add("scale", [n, 3], Init::Constant(0.0));
        let opacity = b.add("opacity", [n, 1], Init::Constant(logit(start.opacity)));
        let center = b.add("center", [n, 2], Init::Constant(0.0));
        let mut fill = |id, value: &dyn Fn(usize) -> f64| {
            b.value_mut(id).iter_mut().enumerate().for_each(|(i, x)| *x = T::from_f64(value(i)));
        };
        fill(position, &|i| start.positions[i / (3 * keys) * 3 + i % 3]);
        fill(quat, &|i| if i % 4 == 0 { 1.0 } else { 0.0 });
        fill(scale, &|i| start.sizes[i / 3].ln());
        fill(center, &|i| ends[i % 2]);
        let width = b.add("width", [n, 2], Init::Constant(WIDTH));
        Self { config, position, quat, scale, opacity, center, width }
    }

    /// The Gaussians at a frame, whole or fractional.
    pub fn at_frame<'t, T: Real>(&self, cx: Context<'t, '_, T>, frame: f64) -> Moved<'t, T> {
        let KeysConfig { interval, margin, .. } = self.config;
        let (key, d) = self.config.place(frame);
        let positions = cx.param(self.position);
        let n = positions.shape()[0];
        let p = |k: usize| positions.slice(1, key + k, 1).reshape([n, 3]);
        let [before, from, to, after] = [0, 1, 2, 3].map(p);
        let slopes = [(to - before) * 0.5, (after - from) * 0.5];
        let (d2, d3) = (d * d, d * d * d);
        let means = from * (2.0 * d3 - 3.0 * d2 + 1.0)
            + slopes[0] * (d3 - 2.0 * d2 + d)
            + to * (3.0 * d2 - 2.0 * d3)
            + slopes[1] * (d3 - d2);
        let x = key as f64 + d;
        let (centers, widths) = (cx.param(self.center), cx.param(self.width));
        let side = |of: Var<'t, T>, i: usize| of.slice(1, i, 1).reshape([n]);
        let flank = Flank { margin: margin / (interval as f64 * HALF) };
        let outside = |distance: Var<'t, T>, i: usize| apply_pointwise(flank, [distance.relu(), side(widths, i)]);
        let seen = outside(side(centers, 0) - x, 0) * outside(side(centers, 1) * -1.0 + x, 1);
        Moved {
            means,
            quats: self.rotation(cx, key, d),
            scales: cx.param(self.scale).exp(),
            opacities: cx.param(self.opacity).reshape([n]).sigmoid() * seen,
        }
    }

    /// Quaternions at `d` between two keys, the shorter way around.
    fn rotation<'t, T: Real>(&self, cx: Context<'t, '_, T>, key: usize, d: f64) -> Var<'t, T> {
        let all = cx.param(self.quat);
        let n = all.shape()[0];
        let [from, to] = [1, 2].map(|k| all.slice(1, key + k, 1).reshape([n, 4]).normalize_rows(0.0));
        let dot = (from * to).sum_axis(1);
        let signs: Vec<T> = dot.value().iter().map(|dot| if *dot < T::ZERO { -T::ONE } else { T::ONE }).collect();
        let signs = cx.tape.constant(&signs, [n]);
        let share = (dot * signs).map(SlerpShare { part: d });
        let spread = |x: Var<'t, T>| x.reshape([n, 1]).expand([n, 4]);
        (from * spread(share) + to * spread(signs) * spread(share * -1.0 + 1.0)).normalize_rows(0.0)
    }
}

impl<T: Real> Motion<T> for Keys {
    fn rows(&self) -> Vec<ParamId> {
        vec![self.position, self.quat, self.scale, self.opacity, self.center, self.width]
    }

    fn at<'t>(&self, cx: Context<'t, '_, T>, time: f64) -> Moved<'t, T> {
        self.at_frame(cx, time * self.config.frames as f64)
    }

    /// 1e-4 mean |p_0 - p_n|: the distance of the last key from the first.
    fn regularizer<'t>(&self, cx: Context<'t, '_, T>) -> Option<Var<'t, T>> {
        let positions = cx.param(self.position);
        let (n, keys) = (positions.shape()[0], positions.shape()[1]);
        let end = |k: usize| positions.slice(1, k, 1).reshape([n, 3]);
        Some((end(keys - 1) - end(0)).abs().mean() * STILL)
    }
}

/// Gaussians that stand still or drift: mu + displacement t. Ex4DGS combines them with keyed ones.
#[derive(Clone, Copy, Debug)]
pub struct Drift {
    raw: RawGaussians,
    displacement: ParamId,
}

impl Drift {
    /// Builds the raw Gaussians and `displacement` `[N, 3]`, without motion at first.
    pub fn new<T: Real>(mut b: Builder<'_, T>, start: &Start<'_>) -> Self {
        let raw = RawGaussians::new(&mut b, start);
        Self { raw, displacement: b.add("displacement", [start.count(), 3], Init::Constant(0.0)) }
    }
}

impl<T: Real> Motion<T> for Drift {
    fn rows(&self) -> Vec<ParamId> {
        [self.raw.ids(), vec![self.displacement]].concat()
    }

    fn at<'t>(&self, cx: Context<'t, '_, T>, time: f64) -> Moved<'t, T> {
        let [mean, scale, quat, opacity] = self.raw.vars(cx);
        Moved::activated([mean + cx.param(self.displacement) * time, scale, quat, opacity])
    }

    /// 1e-4 mean log(|displacement| + 1e-3), over all coordinates.
    fn regularizer<'t>(&self, cx: Context<'t, '_, T>) -> Option<Var<'t, T>> {
        Some((cx.param(self.displacement).abs() + NEAR).ln().mean() * STILL)
    }
}
