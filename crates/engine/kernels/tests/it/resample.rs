//! Resampling against direct two-dimensional sums, and its gradient as the adjoint.

use crate::{assert_close, noise, threads, widen};
use weaver_kernels::Real;
use weaver_kernels::reduce::dot;
use weaver_kernels::resample::Resample;

/// Output pixel (i, j) as the sum of all input pixels with weights `wy(i, y) * wx(j, x)`.
fn direct(from: [usize; 2], to: [usize; 2], x: &[f64], weight: impl Fn(usize, usize, usize, usize) -> f64) -> Vec<f64> {
    let mut out = vec![];
    for plane in x.chunks(from[0] * from[1]) {
        for i in 0..to[0] {
            for j in 0..to[1] {
                let at = |y: usize, x: usize| {
                    weight(from[0], to[0], i, y) * weight(from[1], to[1], j, x) * plane[y * from[1] + x]
                };
                out.push((0..from[0]).map(|y| (0..from[1]).map(|x| at(y, x)).sum::<f64>()).sum());
            }
        }
    }
    out
}

/// A triangle around the source position; the part that falls outside goes to the border pixel.
fn triangle(align: bool) -> impl Fn(usize, usize, usize, usize) -> f64 {
    move |n, m, i, x| {
        let at = match (align, m) {
            (true, 1) => 0.0,
            (true, _) => i as f64 * (n as f64 - 1.0) / (m as f64 - 1.0),
            _ => (i as f64 + 0.5) * n as f64 / m as f64 - 0.5,
        };
        (1.0 - (at.clamp(0.0, n as f64 - 1.0) - x as f64).abs()).max(0.0)
    }
}

/// Keys' kernel in powers of x, for its two usual parameters.
fn keys(x: f64, powers: [[f64; 4]; 2]) -> f64 {
    let polynomial = |[a, b, c, d]: [f64; 4]| a * x.abs().powi(3) + b * x.abs().powi(2) + c * x.abs() + d;
    match x.abs() {
        x if x < 1.0 => polynomial(powers[0]),
        x if x < 2.0 => polynomial(powers[1]),
        _ => 0.0,
    }
}

/// The slope at the ends of the middle piece is -1/2.
fn antialiased_cubic(n: usize, m: usize, i: usize, x: usize) -> f64 {
    let scale = n as f64 / m as f64;
    let powers = [[1.5, -2.5, 0.0, 1.0], [-0.5, 2.5, -4.0, 2.0]];
    let raw = |x: usize| keys(((i as f64 + 0.5) * scale - 0.5 - x as f64) / scale.max(1.0), powers);
    raw(x) / (0..n).map(raw).sum::<f64>()
}

/// The slope is -3/4; a border pixel has the weights of the two positions that may lie beyond it, too.
fn cubic(n: usize, m: usize, i: usize, x: usize) -> f64 {
    let at = (i as f64 + 0.5) * n as f64 / m as f64 - 0.5;
    let raw = |x: f64| keys(at - x, [[1.25, -2.25, 0.0, 1.0], [-0.75, 3.75, -6.0, 3.0]]);
    let beyond = |first: bool, sign: f64| if first { raw(x as f64 + sign) + raw(x as f64 + 2.0 * sign) } else { 0.0 };
    raw(x as f64) + beyond(x == 0, -1.0) + beyond(x + 1 == n, 1.0)
}

fn average(width: usize) -> impl Fn(usize, usize, usize, usize) -> f64 {
    move |n, _, i, x| {
        let inside = |x: usize| x.abs_diff(i) <= width / 2;
        f64::from(u8::from(inside(x))) / (0..n).filter(|x| inside(*x)).count() as f64
    }
}

fn agrees<T: Real>(plan: &Resample<T>, weight: impl Fn(usize, usize, usize, usize) -> f64, tolerance: f64) {
    let (from, to) = (plan.input_size(), plan.output_size());
    let planes = 3;
    let x = noise::<T>(planes * from[0] * from[1], 1);
    let mut y = vec![T::from_f64(f64::NAN); planes * to[0] * to[1]];
    plan.forward(&x, &mut y);
    assert_close(&y, &direct(from, to, &widen(&x), weight), tolerance, &format!("{from:?} to {to:?}"));
    let dy = noise::<T>(y.len(), 2);
    let mut dx = vec![T::from_f64(f64::NAN); x.len()];
    plan.backward(&dy, (&mut dx, T::ZERO));
    let (forward, backward) = (dot(&y, &dy).to_f64(), dot(&x, &dx).to_f64());
    assert!((forward - backward).abs() < tolerance * (10.0 + forward.abs()), "adjoint: {forward} {backward}");
    let mut twice = dx.clone();
    plan.backward(&dy, (&mut twice, T::ONE));
    dx.iter().zip(&twice).for_each(|(a, b)| assert_close(&[*b], &[2.0 * a.to_f64()], tolerance, "accumulated"));
}

fn all<T: Real>(tolerance: f64) {
    let sizes = [[6, 8], [12, 16], [5, 7], [1, 9], [48, 13], [1, 1]];
    for from in sizes {
        for to in sizes {
            agrees(&Resample::<T>::bilinear(from, to, true), triangle(true), tolerance);
            agrees(&Resample::<T>::bilinear(from, to, false), triangle(false), tolerance);
            agrees(&Resample::<T>::bicubic(from, to), cubic, tolerance);
            agrees(&Resample::<T>::bicubic_antialiased(from, to), antialiased_cubic, tolerance);
        }
        for width in [1, 3, 5] {
            agrees(&Resample::<T>::box_filter(from, width), average(width), tolerance);
        }
    }
}

#[test]
fn matches_direct_sums() {
    all::<f64>(1e-12);
    all::<f32>(1e-5);
}

#[test]
fn same_bits_at_any_thread_count() {
    let plan = Resample::bilinear([24, 32], [48, 64], true);
    let x = noise::<f32>(7 * 24 * 32, 1);
    threads(|| {
        let (mut y, mut dx) = (vec![0.0; 7 * 48 * 64], vec![0.0; x.len()]);
        plan.forward(&x, &mut y);
        plan.backward(&y, (&mut dx, 0.0));
        [y, dx].concat()
    });
}
