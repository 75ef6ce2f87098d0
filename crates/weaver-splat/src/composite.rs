//! Front-to-back blending of a tile's splats.

use crate::project::Splat;
use crate::scene::{ALPHA_MIN, TRANSMITTANCE_END};
use crate::tiles::centres;
use weaver_kernels::Real;

/// Planes of a tile: transmittance, red, green, blue, depth.
pub(crate) const PLANES: usize = 5;

/// The thresholds of blending, and the tile's place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Blend<T> {
    pub alpha_max: T,
    pub alpha_min: T,
    pub end: T,
    pub half: T,
}

impl<T: Real> Blend<T> {
    pub fn new(alpha_max: f64) -> Self {
        Self {
            alpha_max: T::from_f64(alpha_max),
            alpha_min: T::from_f64(ALPHA_MIN),
            end: T::from_f64(TRANSMITTANCE_END),
            half: T::from_f64(0.5),
        }
    }
}

/// Where a tile lies in its image.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Window {
    /// Left and top pixel.
    pub corner: (usize, usize),
    /// Pixels of the tile that are in the image.
    pub columns: usize,
    pub rows: usize,
}

/// The centres of `S` pixels from `first`.
#[inline(always)]
pub(crate) fn pixel_centres<T: Real, const S: usize>(first: usize) -> [T; S] {
    std::array::from_fn(|i| T::from_f64((first + i) as f64 + 0.5))
}

/// The rows of a tile that a splat may be seen in.
#[inline(always)]
pub(crate) fn rows_of<T: Real>(splat: &Splat<T>, window: &Window) -> std::ops::Range<usize> {
    let half_height = splat.reach / splat.r;
    let slack = T::from_f64(1e-3) + T::from_f64(4.0) * T::EPSILON * splat.y.abs();
    let centre = splat.y - T::from_usize(window.corner.1);
    centres((centre - half_height - slack).to_f64(), (centre + half_height + slack).to_f64(), window.rows)
}

/// Blends splats over a tile of `S` x `S` pixels, front to back.
///
/// `planes` are [`PLANES`] x S x S; `last` gets, for each pixel, 1 + the list index of the last splat seen there.
#[inline(always)]
pub(crate) fn composite<'a, T: Real, const S: usize>(
    blend: &Blend<T>,
    window: &Window,
    splats: impl Iterator<Item = &'a Splat<T>>,
    planes: &mut [T],
    last: &mut [u32],
) {
    let pixels = S * S;
    let (transmittance, rest) = planes.split_at_mut(pixels);
    let (red, rest) = rest.split_at_mut(pixels);
    let (green, rest) = rest.split_at_mut(pixels);
    let (blue, depth) = rest.split_at_mut(pixels);
    transmittance.fill(T::ONE);
    red.fill(T::ZERO);
    green.fill(T::ZERO);
    blue.fill(T::ZERO);
    depth.fill(T::ZERO);
    last.fill(0);
    let mut live = [[T::ZERO; S]; S];
    for row in &mut live[..window.rows] {
        row[..window.columns].fill(T::ONE);
    }
    let transmittance = transmittance.as_chunks_mut::<S>().0;
    let red = red.as_chunks_mut::<S>().0;
    let green = green.as_chunks_mut::<S>().0;
    let blue = blue.as_chunks_mut::<S>().0;
    let depth = depth.as_chunks_mut::<S>().0;
    let last = last.as_chunks_mut::<S>().0;
    let x = pixel_centres::<T, S>(window.corner.0);
    let y = pixel_centres::<T, S>(window.corner.1);
    for (index, splat) in splats.enumerate() {
        if index % 16 == 15 && live.iter().flatten().all(|&l| l == T::ZERO) {
            break;
        }
        let Splat { p, opacity, z, colour, .. } = *splat;
        let seen = index as u32 + 1;
        for row in rows_of(splat, window) {
            let dy = y[row] - splat.y;
            let (qdy, v) = (splat.q * dy, splat.r * dy);
            let vv = v * v;
            let (live, transmittance) = (&mut live[row], &mut transmittance[row]);
            let (red, green, blue) = (&mut red[row], &mut green[row], &mut blue[row]);
            let (depth, last) = (&mut depth[row], &mut last[row]);
            for i in 0..S {
                let u = p * (x[i] - splat.x) + qdy;
                let raw = opacity * (-(blend.half * (u * u + vv))).exp();
                let capped = if raw > blend.alpha_max { blend.alpha_max } else { raw };
                // False where it is not a number.
                let alpha = if capped >= blend.alpha_min { capped * live[i] } else { T::ZERO };
                let before = transmittance[i];
                let after = before * (T::ONE - alpha);
                let open = after > blend.end;
                let weight = if open { alpha * before } else { T::ZERO };
                transmittance[i] = if open { after } else { before };
                live[i] = if open { live[i] } else { T::ZERO };
                last[i] = if weight > T::ZERO { seen } else { last[i] };
                red[i] += weight * colour[0];
                green[i] += weight * colour[1];
                blue[i] += weight * colour[2];
                depth[i] += weight * z;
            }
        }
    }
}
