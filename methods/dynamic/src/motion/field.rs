//! 4DGaussians (Wu et al., CVPR 2024, arXiv 2310.08528): offsets by a field over space and time that is a product of
//! planes.

use super::heads::OffsetHeads;
use super::{Motion, Moved, RawGaussians, Start};
use crate::plane_sample;
use weaver_autograd::{ParamId, Real, Var, ops};
use weaver_nn::{Builder, Context, Init};

/// The axes of each plane: along its columns, along its rows. 3 is time.
const PLANES: [(&str, [usize; 2]); 6] =
    [("xy", [0, 1]), ("xz", [0, 2]), ("xt", [0, 3]), ("yz", [1, 2]), ("yt", [1, 3]), ("zt", [2, 3])];
const TIME: usize = 3;
/// Weights of the regularizers, as published.
const ROUGH_SPACE: f64 = 2e-4;
const ROUGH_TIME: f64 = 1e-3;
const STILL: f64 = 1e-4;

/// Sizes of a [`Field`].
#[derive(Clone, Debug, PartialEq)]
pub struct FieldConfig {
    /// Lower and upper corner of the box that the planes cover.
    pub bounds: [[f64; 3]; 2],
    /// Cells along x, y, z and time at the first level, at least 3 each (second differences need as many): 64, 64, 64,
    /// 150 as published.
    pub resolution: [usize; 4],
    /// Levels; each further one has twice as many cells in space: 2 as published.
    pub levels: usize,
    /// Channels of a plane: 16 as published.
    pub channels: usize,
    /// Hidden width: 128 as published.
    pub width: usize,
}

/// Offsets by the features of a Gaussian's place and time: at each level the product of samples of six planes, the
/// levels side by side.
///
/// A place outside the box has the features of the border. Time runs over the whole grid, as [-1, 1]; the released code
/// passes time from 0 to 1 instead, and uses half of its planes.
#[derive(Clone, Debug)]
pub struct Field {
    config: FieldConfig,
    raw: RawGaussians,
    /// The six planes of each level.
    planes: Vec<[ParamId; 6]>,
    heads: OffsetHeads,
}

impl Field {
    /// Builds the raw Gaussians, `plane{l}.{xy, ..}` `[C, rows, columns]` and the heads, without motion at first.
    /// Planes of space begin in [0.1, 0.5], planes with time at 1.
    ///
    /// # Panics
    /// If the resolution is below 3, or the box is empty.
    pub fn new<T: Real>(mut b: Builder<'_, T>, start: &Start<'_>, config: FieldConfig) -> Self {
        assert!(config.resolution.iter().all(|cells| *cells >= 3), "a field has at least 3 cells along each axis");
        assert!((0..3).all(|axis| config.bounds[0][axis] < config.bounds[1][axis]), "a field's box has a volume");
        let raw = RawGaussians::new(&mut b, start);
        let planes = (0..config.levels)
            .map(|level| {
                let cells = |axis: usize| config.resolution[axis] * if axis == TIME { 1 } else { 1 << level };
                PLANES.map(|(name, [columns, rows])| {
                    let init = if rows == TIME { Init::Constant(1.0) } else { Init::Uniform(0.2) };
                    let shape = [config.channels, cells(rows), cells(columns)];
                    let id = b.add(format_args!("plane{level}.{name}"), shape, init);
                    if rows != TIME {
                        b.value_mut(id).iter_mut().for_each(|x| *x += T::from_f64(0.3));
                    }
                    id
                })
            })
            .collect();
        let heads = OffsetHeads::new(&mut b, config.levels * config.channels, config.width);
        Self { config, raw, planes, heads }
    }

    /// The sum over planes, of space or with time, of the mean squared second difference along their rows.
    pub fn roughness<'t, T: Real>(&self, cx: Context<'t, '_, T>, of_time: bool) -> Var<'t, T> {
        let rough = |plane: Var<'t, T>| {
            let inner = plane.shape()[1] - 2;
            let row = |first: usize| plane.slice(1, first, inner);
            (row(2) - row(1) * 2.0 + row(0)).square().mean()
        };
        self.of_planes(cx, of_time, rough)
    }

    /// The sum over planes with time of the mean |1 - x|: the amount of motion.
    pub fn stir<'t, T: Real>(&self, cx: Context<'t, '_, T>) -> Var<'t, T> {
        self.of_planes(cx, true, |plane| (plane * -1.0 + 1.0).abs().mean())
    }

    fn of_planes<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        of_time: bool,
        f: impl Fn(Var<'t, T>) -> Var<'t, T>,
    ) -> Var<'t, T> {
        let all = self.planes.iter().flat_map(|level| level.iter().zip(PLANES));
        let asked = all.filter(|(_, (_, [_, rows]))| (*rows == TIME) == of_time);
        asked.map(|(id, _)| f(cx.param(*id))).reduce(|a, b| a + b).unwrap_or_else(|| cx.tape.scalar(T::ZERO))
    }
}

impl<T: Real> Motion<T> for Field {
    fn rows(&self) -> Vec<ParamId> {
        self.raw.ids()
    }

    fn at<'t>(&self, cx: Context<'t, '_, T>, time: f64) -> Moved<'t, T> {
        let raw = self.raw.vars(cx);
        let n = raw[0].shape()[0];
        let [low, high] = self.config.bounds;
        let coordinates: [Var<'t, T>; 4] = std::array::from_fn(|axis| {
            if axis == TIME {
                return cx.tape.constant(&vec![T::from_f64(2.0 * time - 1.0); n], [n, 1]);
            }
            let scale = 2.0 / (high[axis] - low[axis]);
            (raw[0].slice(1, axis, 1) - low[axis]) * scale - 1.0
        });
        let levels = self.planes.iter().map(|planes| {
            let samples = planes.iter().zip(PLANES).map(|(plane, (_, [columns, rows]))| {
                plane_sample(cx.param(*plane), ops::concat(&[coordinates[columns], coordinates[rows]], 1))
            });
            samples.reduce(|a, b| a * b).expect("there are six planes")
        });
        let levels: Vec<Var<'t, T>> = levels.collect();
        Moved::activated(self.heads.added(cx, ops::concat(&levels, 1), raw))
    }

    /// 2e-4 times the roughness of planes of space, 1e-3 times the roughness of planes with time, 1e-4 times the amount
    /// of motion.
    fn regularizer<'t>(&self, cx: Context<'t, '_, T>) -> Option<Var<'t, T>> {
        let [space, time] = [false, true].map(|of_time| self.roughness(cx, of_time));
        Some(space * ROUGH_SPACE + time * ROUGH_TIME + self.stir(cx) * STILL)
    }
}
