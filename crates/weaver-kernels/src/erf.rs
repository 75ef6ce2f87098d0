//! The Gauss error function, which the standard library lacks.

/// erf(x) in `f64`.
#[inline(always)]
pub fn erf_f64(x: f64) -> f64 {
    // Placeholder-free simple form: Abramowitz-Stegun is too coarse, so integrate the series or the
    // continued fraction, whichever converges.
    let a = x.abs();
    if a > 6.0 {
        return x.signum();
    }
    if a < 2.5 {
        let (mut term, mut sum, mut n) = (a, a, 0.0);
        while term.abs() > 1e-17 * sum.abs() {
            n += 1.0;
            term *= -a * a / n;
            let add = term / (2.0 * n + 1.0);
            sum += add;
            if n > 200.0 {
                break;
            }
        }
        return x.signum() * sum * std::f64::consts::FRAC_2_SQRT_PI;
    }
    let mut f = 0.0;
    for k in (1..=60).rev() {
        f = k as f64 / 2.0 / (a + f);
    }
    x.signum() * (1.0 - (-a * a).exp() / ((a + f) * std::f64::consts::PI.sqrt()))
}

/// erf(x) in `f32`.
#[inline(always)]
pub fn erf_f32(x: f32) -> f32 {
    erf_f64(f64::from(x)) as f32
}
