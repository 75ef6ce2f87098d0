//! The sinusoidal position signal that the dense heads add to their maps.

use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::parallel;

/// Weight of the signal in the dense heads.
pub const POSITION_WEIGHT: f64 = 0.1;
/// Ratio between the highest and the (excluded) lowest frequency.
const BASE: f64 = 100.0;

#[derive(Debug)]
struct AddPosition {
    height: usize,
    width: usize,
}

/// Fills `[sin | cos]` of every frequency at every coordinate: `[2 * frequencies, n]`.
///
/// Coordinates run evenly from -reach (n - 1) / n to +reach (n - 1) / n: the middles of n cells.
fn waves<T: Real>(out: &mut [T], frequencies: usize, n: usize, reach: f64) {
    for k in 0..frequencies {
        let omega = BASE.powf(-(k as f64) / frequencies as f64);
        for i in 0..n {
            let angle = omega * reach * (2.0 * i as f64 + 1.0 - n as f64) / n as f64;
            out[k * n + i] = T::from_f64(POSITION_WEIGHT * angle.sin());
            out[(frequencies + k) * n + i] = T::from_f64(POSITION_WEIGHT * angle.cos());
        }
    }
}

impl<T: Real> Op<T> for AddPosition {
    fn name(&self) -> &'static str {
        "add_position"
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(
            ins.len() == 1 && ins[0].rank() == 4 && ins[0][1].is_multiple_of(4),
            "maps [N, C, h, w] with C divisible by 4"
        );
        Ok(Shapes::one(ins[0]))
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], pool: &Pool) {
        let shape = ins[0].shape();
        let (channels, h, w) = (shape[1], shape[2], shape[3]);
        let half = channels / 2;
        let aspect = self.width as f64 / self.height as f64;
        let diagonal = aspect.hypot(1.0);
        let mut along_x = pool.buffer::<T>(half * w);
        let mut along_y = pool.buffer::<T>(half * h);
        waves(&mut along_x, channels / 4, w, aspect / diagonal);
        waves(&mut along_y, channels / 4, h, 1.0 / diagonal);
        parallel::for_chunks(&mut outs[0], h * w, |plane, y| {
            let x = &ins[0].data()[plane * h * w..];
            let c = plane % channels;
            for (row, (y, x)) in y.chunks_mut(w).zip(x.chunks(w)).enumerate() {
                if c < half {
                    let wave = &along_x[c * w..][..w];
                    y.iter_mut().zip(x).zip(wave).for_each(|((y, x), p)| *y = *x + *p);
                } else {
                    let p = along_y[(c - half) * h + row];
                    y.iter_mut().zip(x).for_each(|(y, x)| *y = *x + p);
                }
            }
        });
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { douts, dins, .. } = at;
        if let Some(dx) = &mut dins[0] {
            dx.add(&douts[0]);
        }
    }
}

/// Adds 0.1 times a position signal to maps of an image of `height` x `width` pixels.
///
/// The channels are four equal parts: sin(x omega_k), cos(x omega_k), sin(y omega_k), cos(y omega_k), with omega_k =
/// 100^(-k / (C / 4)); (x, y) are the middles of the map's cells where the image spans +-(W, H) / |(W, H)|. `maps`
/// `[N, C, h, w]` of any size, C divisible by 4, give the same shape. Differentiable. From the DPT heads of VGGT (Wang
/// et al. 2025, arXiv 2503.11651).
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// // A map of one cell lies in the middle of the image: sin 0, cos 0, sin 0, cos 0.
/// let map = weaver_vggt::add_position(tape.constant(&[0.0; 4], [1, 4, 1, 1]), 48, 64);
/// assert_eq!(map.to_vec(), [0.0, 0.1, 0.0, 0.1]);
/// ```
#[track_caller]
pub fn add_position<T: Real>(maps: Var<'_, T>, height: usize, width: usize) -> Var<'_, T> {
    let [y] = maps.tape().apply(AddPosition { height, width }, &[maps]);
    y
}
