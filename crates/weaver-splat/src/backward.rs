//! Backward of blending: a tile's splats from back to front.

use crate::composite::{Blend, Window, pixel_centres, rows_of};
use crate::project::Splat;
use crate::project_backward::MOMENTS;
use weaver_kernels::Real;

/// Gradients that arrive at one view's outputs; `None` is zero.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ViewCotangents<'a, T> {
    /// `[H, W, 3]`
    pub image: Option<&'a [T]>,
    /// `[H, W]`
    pub alpha: Option<&'a [T]>,
    /// `[H, W]`
    pub depth: Option<&'a [T]>,
}

/// What one tile starts from: the cotangents, and the state that blending ended with.
struct TileState<T, const S: usize> {
    /// Transmittance in front of what was not undone yet.
    transmittance: [[T; S]; S],
    /// dL/dT times T of everything behind.
    behind: [[T; S]; S],
    red: [[T; S]; S],
    green: [[T; S]; S],
    blue: [[T; S]; S],
    depth: [[T; S]; S],
}

impl<T: Real, const S: usize> TileState<T, S> {
    #[inline(always)]
    fn new(
        window: &Window,
        width: usize,
        background: [T; 3],
        cotangents: &ViewCotangents<'_, T>,
        transmittance: &[T],
        dbackground: &mut [T],
    ) -> Self {
        let zero = [[T::ZERO; S]; S];
        let mut state = Self { transmittance: zero, behind: zero, red: zero, green: zero, blue: zero, depth: zero };
        dbackground.fill(T::ZERO);
        for row in 0..window.rows {
            for column in 0..window.columns {
                let pixel = (window.corner.1 + row) * width + window.corner.0 + column;
                let left = transmittance[row * S + column];
                let dimage =
                    cotangents.image.map_or([T::ZERO; 3], |d| [d[3 * pixel], d[3 * pixel + 1], d[3 * pixel + 2]]);
                let dalpha = cotangents.alpha.map_or(T::ZERO, |d| d[pixel]);
                let through = dimage[0] * background[0] + dimage[1] * background[1] + dimage[2] * background[2];
                state.transmittance[row][column] = left;
                state.behind[row][column] = left * (through - dalpha);
                state.red[row][column] = dimage[0];
                state.green[row][column] = dimage[1];
                state.blue[row][column] = dimage[2];
                state.depth[row][column] = cotangents.depth.map_or(T::ZERO, |d| d[pixel]);
                for channel in 0..3 {
                    dbackground[channel] += left * dimage[channel];
                }
            }
        }
        state
    }
}

/// Writes the [`Moments`](crate::project_backward::Moments) of each of the tile's splats (flat rows in `moments`) and
/// the tile's part of the background's gradient.
///
/// `transmittance` and `last` are what [`composite`](crate::composite::composite) left. `ABSOLUTE` asks for the sums of
/// absolute gradients of the centres.
#[inline(always)]
pub(crate) fn composite_backward<'a, T: Real, const S: usize, const ABSOLUTE: bool>(
    blend: &Blend<T>,
    (window, width): (&Window, usize),
    background: [T; 3],
    cotangents: &ViewCotangents<'_, T>,
    splat_at: impl Fn(usize) -> &'a Splat<T>,
    (transmittance, last): (&[T], &[u32]),
    moments: &mut [T],
    dbackground: &mut [T],
) {
    let mut state = TileState::<T, S>::new(window, width, background, cotangents, transmittance, dbackground);
    let last = last.as_chunks::<S>().0;
    let mut row_last = [0; S];
    for (row, last) in row_last.iter_mut().zip(last) {
        *row = last.iter().fold(0, |m, &l| m.max(l));
    }
    let seen = row_last.iter().fold(0, |m, &l| m.max(l)) as usize;
    let x = pixel_centres::<T, S>(window.corner.0);
    let y = pixel_centres::<T, S>(window.corner.1);
    let (rows, unseen) = moments.split_at_mut(seen * MOMENTS);
    unseen.fill(T::ZERO);
    for (index, out) in rows.chunks_exact_mut(MOMENTS).enumerate().rev() {
        let splat = splat_at(index);
        let index = index as u32;
        let mut sums = [[T::ZERO; S]; MOMENTS];
        for row in rows_of(splat, window) {
            if index < row_last[row] {
                let dy = y[row] - splat.y;
                undo_row::<T, S, ABSOLUTE>(blend, splat, (&x, dy), (index, &last[row]), &mut state, row, &mut sums);
            }
        }
        for (out, lanes) in out.iter_mut().zip(&sums) {
            *out = lane_sum(lanes);
        }
    }
}

/// Takes one splat back out of one row of pixels.
#[inline(always)]
fn undo_row<T: Real, const S: usize, const ABSOLUTE: bool>(
    blend: &Blend<T>,
    splat: &Splat<T>,
    (x, dy): (&[T; S], T),
    (index, last): (u32, &[u32; S]),
    state: &mut TileState<T, S>,
    row: usize,
    sums: &mut [[T; S]; MOMENTS],
) {
    let Splat { p, q, r, opacity, z, colour, .. } = *splat;
    let (qdy, v) = (q * dy, r * dy);
    let vv = v * v;
    let (transmittance, behind) = (&mut state.transmittance[row], &mut state.behind[row]);
    let (red, green, blue, depth) = (&state.red[row], &state.green[row], &state.blue[row], &state.depth[row]);
    for i in 0..S {
        let u = p * (x[i] - splat.x) + qdy;
        let raw = opacity * (-(blend.half * (u * u + vv))).exp();
        let capped = raw > blend.alpha_max;
        let alpha = if capped { blend.alpha_max } else { raw };
        let hit = (alpha >= blend.alpha_min) & (index < last[i]);
        let alpha = if hit { alpha } else { T::ZERO };
        let u = if hit { u } else { T::ZERO };
        let rest = T::ONE / (T::ONE - alpha);
        let before = transmittance[i] * rest;
        let weight = alpha * before;
        let value = red[i] * colour[0] + green[i] * colour[1] + blue[i] * colour[2] + depth[i] * z;
        let dalpha = before * value - behind[i] * rest;
        let g = if capped { T::ZERO } else { alpha * dalpha };
        transmittance[i] = before;
        behind[i] += weight * value;
        let gu = g * u;
        sums[0][i] += g;
        sums[1][i] += gu;
        sums[2][i] += g * v;
        sums[3][i] += gu * u;
        sums[4][i] += gu * v;
        sums[5][i] += g * vv;
        sums[6][i] += weight * red[i];
        sums[7][i] += weight * green[i];
        sums[8][i] += weight * blue[i];
        sums[9][i] += weight * depth[i];
        if ABSOLUTE {
            sums[10][i] += (p * gu).abs();
            sums[11][i] += (q * gu + r * v * g).abs();
        }
    }
}

/// The sum of the lanes, by halves: the same order on any processor.
#[inline(always)]
fn lane_sum<T: Real, const S: usize>(lanes: &[T; S]) -> T {
    let mut lanes = *lanes;
    let mut half = S / 2;
    while half > 0 {
        for i in 0..half {
            let upper = lanes[i + half];
            lanes[i] += upper;
        }
        half /= 2;
    }
    lanes[0]
}
