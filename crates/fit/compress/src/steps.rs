//! The choice of steps: each kind of number rounded so that a bit more or less would change the pictures' error as much
//! as in any other.
//!
//! Of each kind g the error of pictures is measured at a step and at half of it, everything else being fine, and
//! `D_g(q) = c q^p` is laid through both; so is the number of bits, `R_g(q) = r - s log2 q`. With errors that add up,
//! the least rate for an error has the same `-dD/dR = λ` in all kinds, at `q = (λ s / (p c ln 2))^(1/p)`. λ is then
//! searched for the wanted quality, which is measured with everything rounded.

use crate::{CompressError, Judge};
use weaver_codec::lite::{Quality, decode, encode, order_zero_bits, rounded};
use weaver_scene::Gaussians;

/// The largest quality that can be requested, dB: beyond, rounding of 8-bit pictures is larger.
pub const MOST_DECIBELS: f64 = 65.0;

/// Kinds of numbers, in the order of [`order_zero_bits`].
const KINDS: usize = 6;
/// Steps so small that they cause no error beside the measured kind's.
const FINE: Quality = Quality {
    position: 0.0005,
    scale_step: 0.0005,
    opacity_levels: 4095,
    rotation_step: 0.0001,
    dc_step: 0.0002,
    sh_step: 0.0002,
    dead_zone: 0.0,
    adaptation: 0.0,
    rotation_adaptation: 0.0,
};
/// Steps are made four times finer so often at most before they are measured: where all numbers are rounded to nothing,
/// errors do not follow the step.
const FINER: usize = 4;
/// The most that a step grows or shrinks from the one that was measured.
const REACH: f64 = 16.0;
/// Bounds of the exponent of an error: 2 for numbers that pictures are linear in, less where Gaussians hide each other.
const EXPONENT: [f64; 2] = [0.5, 3.0];
/// Halvings of the interval in which λ is searched.
const ROUNDS: usize = 9;
/// Interval of the logarithm of λ beside its first guess.
const INTERVAL: f64 = 6.0;
/// Distance from the wanted quality at which the search ends, dB.
const CLOSE: f64 = 0.03;

/// One measurement, for a progress bar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Round {
    /// Measurements done.
    pub done: usize,
    /// Measurements at most.
    pub of: usize,
    /// Quality of the last try, dB; `None` while steps are measured.
    pub psnr: Option<f64>,
}

/// A compressed scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Compressed {
    /// The stream, which [`decode`](weaver_codec::lite::decode) reads.
    pub bytes: Vec<u8>,
    /// The steps that were chosen.
    pub quality: Quality,
    /// Quality beside the scene, dB, of the pictures that its steps were chosen by.
    pub psnr: f64,
}

impl Compressed {
    /// Quality of its pictures beside the scene's, dB, by another judge: a reported quality should come from pictures
    /// that had no part in the choice of steps.
    ///
    /// # Errors
    /// If it cannot be drawn.
    pub fn judged_by(&self, judge: &mut Judge) -> Result<f64, CompressError> {
        judge.psnr(&decode(&self.bytes)?)
    }
}

/// Compresses a scene so that its pictures have at least so many decibels beside the scene's.
///
/// # Errors
/// Where the scene cannot be encoded or drawn, the quality is out of range, or no setting reaches it.
pub fn compress(
    gaussians: &Gaussians,
    decibels: f64,
    judge: &mut Judge,
    mut observe: impl FnMut(Round),
) -> Result<Compressed, CompressError> {
    if !(decibels > 0.0 && decibels <= MOST_DECIBELS) {
        return Err(CompressError::Quality { most: MOST_DECIBELS, found: decibels });
    }
    let mut measured = 0;
    let curves = Curves::measure(gaussians, decibels, judge, |done| {
        measured = done;
        observe(Round { done, of: done.max(2 * KINDS) + ROUNDS, psnr: None });
    })?;
    let of = measured + ROUNDS;
    let middle = curves.first_guess(decibels);
    let (mut finer, mut coarser) = (middle - INTERVAL, middle + INTERVAL);
    let mut best: Option<(Quality, f64)> = None;
    for round in 0..ROUNDS {
        let log_lambda = if round == 0 { middle } else { (finer + coarser) / 2.0 };
        let quality = curves.quality(log_lambda.exp());
        let psnr = judge.psnr(&rounded(gaussians, &quality)?)?;
        observe(Round { done: measured + round + 1, of, psnr: Some(psnr) });
        if psnr >= decibels {
            finer = log_lambda;
            best = Some((quality, psnr));
            if psnr < decibels + CLOSE {
                break;
            }
        } else {
            coarser = log_lambda;
        }
    }
    let (quality, psnr) = match best {
        Some(best) => best,
        None => {
            let reached = judge.psnr(&rounded(gaussians, &FINE)?)?;
            if reached < decibels {
                return Err(CompressError::TooFine { wanted: decibels, reached });
            }
            (FINE, reached)
        }
    };
    observe(Round { done: of, of, psnr: Some(psnr) });
    Ok(Compressed { bytes: encode(gaussians, &quality)?, quality, psnr })
}

/// Error and bits of one kind by its step `q`.
#[derive(Clone, Copy, Debug, Default)]
struct Curve {
    /// Step at which it was measured.
    step: f64,
    /// Mean square of the pictures' error there.
    error: f64,
    /// Its exponent.
    exponent: f64,
    /// Bits that double the precision.
    bits: f64,
}

impl Curve {
    /// The step at which a bit more takes so much off the error.
    fn step_at(&self, lambda: f64) -> f64 {
        if self.error <= 0.0 || self.bits <= 0.0 {
            // No picture shows it, or it takes no bits.
            return if self.bits > 0.0 { self.step * REACH } else { self.step };
        }
        // At step x q0: p D(q0) x^p ln 2 = λ s.
        let x =
            (lambda * self.bits / (std::f64::consts::LN_2 * self.exponent * self.error)).powf(self.exponent.recip());
        self.step * x.clamp(1.0 / REACH, REACH)
    }
}

/// Curves of all kinds.
#[derive(Debug)]
struct Curves([Curve; KINDS]);

impl Curves {
    /// Measures each kind at steps that cause no more error than is wanted.
    fn measure(
        gaussians: &Gaussians,
        decibels: f64,
        judge: &mut Judge,
        mut done: impl FnMut(usize),
    ) -> Result<Self, CompressError> {
        let base = Quality::default();
        // Adapted as in the stream that is written: larger steps where less shows.
        let Quality { adaptation, rotation_adaptation, .. } = base;
        let rest = Quality { adaptation, rotation_adaptation, ..FINE };
        let least = judge.mean_square(&rounded(gaussians, &rest)?)?;
        let mut curves = [Curve::default(); KINDS];
        let mut count = 0;
        for (kind, curve) in curves.iter_mut().enumerate() {
            let mut error = |step: f64| -> Result<f64, CompressError> {
                let error = judge.mean_square(&rounded(gaussians, &with_step(rest, kind, step))?)?;
                count += 1;
                done(count);
                Ok((error - least).max(0.0))
            };
            let mut step = step_of(&base, kind);
            let mut whole = error(step)?;
            for _ in 0..FINER {
                // Not so fine that the rest causes as much.
                if whole <= mean_square(decibels) || step < 16.0 * step_of(&FINE, kind) {
                    break;
                }
                step /= 4.0;
                whole = error(step)?;
            }
            let half = error(step / 2.0)?;
            let exponent = if half > 0.0 { (whole / half).log2() } else { 2.0 };
            let exponent = if exponent.is_finite() { exponent.clamp(EXPONENT[0], EXPONENT[1]) } else { 2.0 };
            *curve = Curve { step, error: whole, exponent, bits: 0.0 };
        }
        let at = |factor: f64| {
            let steps = curves.iter().enumerate();
            steps.fold(base, |quality, (kind, curve)| with_step(quality, kind, factor * curve.step))
        };
        let [coarse, fine] = [order_zero_bits(gaussians, &at(1.0))?, order_zero_bits(gaussians, &at(0.5))?];
        for (kind, curve) in curves.iter_mut().enumerate() {
            curve.bits = fine[kind].1 - coarse[kind].1;
        }
        Ok(Self(curves))
    }

    /// The logarithm of λ at which errors that add up give so many decibels.
    fn first_guess(&self, decibels: f64) -> f64 {
        let wanted = mean_square(decibels);
        let error = |log_lambda: f64| -> f64 {
            let of = |curve: &Curve| curve.error * (curve.step_at(log_lambda.exp()) / curve.step).powf(curve.exponent);
            self.0.iter().map(of).sum()
        };
        let (mut low, mut high) = (-80.0, 20.0);
        for _ in 0..60 {
            let middle = (low + high) / 2.0;
            *(if error(middle) < wanted { &mut low } else { &mut high }) = middle;
        }
        low
    }

    fn quality(&self, lambda: f64) -> Quality {
        let chosen = self.0.iter().enumerate();
        chosen.fold(Quality::default(), |quality, (kind, curve)| with_step(quality, kind, curve.step_at(lambda)))
    }
}

/// The mean square error of so many decibels.
fn mean_square(decibels: f64) -> f64 {
    10_f64.powf(-decibels / 10.0)
}

/// The step of a kind.
fn step_of(quality: &Quality, kind: usize) -> f64 {
    match kind {
        0 => quality.position,
        1 => quality.scale_step,
        2 => 1.0 / f64::from(quality.opacity_levels),
        3 => quality.rotation_step,
        4 => quality.dc_step,
        _ => quality.sh_step,
    }
}

/// The same steps, but for one kind.
fn with_step(quality: Quality, kind: usize, step: f64) -> Quality {
    match kind {
        0 => Quality { position: step, ..quality },
        1 => Quality { scale_step: step, ..quality },
        2 => Quality { opacity_levels: (1.0 / step).round().clamp(3.0, 4095.0) as u32, ..quality },
        3 => Quality { rotation_step: step, ..quality },
        4 => Quality { dc_step: step, ..quality },
        _ => Quality { sh_step: step, ..quality },
    }
}
