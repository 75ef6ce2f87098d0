//! Lifting: features of pixels to features of Gaussians, block by block of channels.

use crate::error::LiftError;
use crate::observations::Observations;
use crate::operator::Operator;
use crate::passes::{Loss, Passes, for_rows};
use crate::rows::Rows;
use crate::solver::{Descent, Solver};
use crate::statistics::Coverage;
use weaver_kernels::Real;

/// Options of lifting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LiftOptions {
    /// Solver of Gaussians' features.
    pub solver: Solver,
    /// For solvers that draw ([`Solver::draws`]): least alpha of a valid pixel; the features of valid pixels are
    /// multiplied by their alpha. `None` for features that are already composited over zeros, such as drawn ones.
    pub least_alpha: Option<f64>,
    /// Channels at a time; bounds memory without changing results.
    pub block: usize,
    /// True if features are divided by their length; zeros stay.
    pub unit: bool,
    /// True to compute the loss as well, in one more pass.
    pub loss: bool,
}

impl Default for LiftOptions {
    fn default() -> Self {
        Self { solver: Solver::exact(5), least_alpha: Some(0.5), block: 64, unit: false, loss: false }
    }
}

impl LiftOptions {
    /// The default options with another solver.
    pub fn with(solver: Solver) -> Self {
        Self { solver, ..Self::default() }
    }

    /// Upper bound on the visits of views, for `channels` channels in `views` views: for a progress display.
    pub fn work(&self, views: usize, channels: usize) -> usize {
        let passes = self.solver.passes() + usize::from(self.loss);
        views * (1 + passes * channels.div_ceil(self.block.max(1)))
    }
}

/// Lifted features.
#[derive(Clone, Debug, PartialEq)]
pub struct Lifted<T> {
    /// X, `[P, F]`; zeros for Gaussians that are not seen.
    pub features: Vec<T>,
    /// F.
    pub channels: usize,
    /// `D_j = sum_i A_ij` over the valid pixels, `[P]`: each Gaussian's visibility.
    pub seen: Vec<T>,
    /// Valid pixels and seen Gaussians.
    pub coverage: Coverage,
    /// Most passes of a block of channels.
    pub passes: usize,
    /// `|A X - B|^2 / |B|^2`, before features become unit vectors; `None` unless [`LiftOptions::loss`] is set.
    pub loss: Option<f64>,
}

/// Finds features of Gaussians such that drawing them gives the features of pixels.
///
/// Geometry stays as it is, so that drawing is linear: no training. `seen_view` is called after each view of each pass,
/// at most [`LiftOptions::work`] times. Memory: `[P, F]` for the result, `[P, block]` three to four times, a view's
/// pixels twice. Same bits at any number of threads and for any size of blocks.
///
/// # Errors
/// No channels, all pixels masked, no Gaussian seen, settings out of range, and errors of operator and observations.
///
/// # Source
/// Xiong et al., Splat Feature Solver, 2026 (row sums, least squares); the damped solver is ours.
///
/// ```
/// use weaver_lift::{Dense, LiftOptions, Maps, Solver, lift};
/// // Two pixels, two Gaussians; the second pixel sees nothing but the second Gaussian.
/// let mut weights = Dense::new(vec![0.5, 0.5, 0.0, 1.0], 2, 1)?;
/// let mut maps = Maps { views: vec![vec![1.5, 2.0]], channels: 1 };
/// let options = LiftOptions::with(Solver::exact(100));
/// let lifted = lift(&mut weights, &mut maps, &options, &mut || ())?;
/// assert!((lifted.features[0] - 1.0_f64).abs() < 1e-4 && (lifted.features[1] - 2.0).abs() < 1e-4);
/// # Ok::<(), weaver_lift::LiftError>(())
/// ```
pub fn lift<T: Real>(
    operator: &mut impl Operator<T>,
    observations: &mut impl Observations<T>,
    options: &LiftOptions,
    seen_view: &mut dyn FnMut(),
) -> Result<Lifted<T>, LiftError> {
    options.solver.check()?;
    let least_alpha = options.least_alpha.filter(|_| options.solver.draws());
    let rows = Rows::new(operator, observations, least_alpha, seen_view)?;
    // Damping pulls toward a mean of the features without alpha.
    let plain = match options.solver {
        Solver::Damped { .. } if least_alpha.is_some() => Some(Rows::new(operator, observations, None, &mut || ())?),
        _ => None,
    };
    let (splats, total) = (operator.splats(), observations.channels());
    let mut features = vec![T::ZERO; splats * total];
    let (mut most, mut loss) = (0, Loss::default());
    let block = options.block.clamp(1, total);
    let mut x = Vec::new();
    for first in (0..total).step_by(block) {
        let channels = first..total.min(first + block);
        let width = channels.len();
        x.resize(splats * width, T::ZERO);
        let mut passes = Passes {
            operator: &mut *operator,
            observations: &mut *observations,
            rows: plain.as_ref().unwrap_or(&rows),
            channels: channels.clone(),
            seen_view: &mut *seen_view,
            drawn: Vec::new(),
            given: Vec::new(),
        };
        let taken = match options.solver {
            Solver::RowSum => passes.row_sum(&mut x).map(|()| 1)?,
            Solver::Squared => passes.squared(&mut x).map(|()| 1)?,
            Solver::Exact { descent: Descent::Iteration, stop } => passes.iterate(&mut x, stop)?,
            Solver::Exact { descent: Descent::ConjugateGradients, stop } => {
                x.fill(T::ZERO);
                passes.conjugate_gradients(&mut x, 0.0, stop)?
            }
            Solver::Damped { mu, stop } => {
                passes.row_sum(&mut x)?;
                passes.rows = &rows;
                1 + passes.conjugate_gradients(&mut x, mu, stop)?
            }
        };
        most = most.max(taken);
        if options.loss {
            let Loss { loss: more, of_zeros } = passes.loss(&x)?;
            loss = Loss { loss: loss.loss + more, of_zeros: loss.of_zeros + of_zeros };
        }
        for_rows(&mut features, total, |j, row| row[channels.clone()].copy_from_slice(&x[j * width..(j + 1) * width]));
    }
    if options.unit {
        to_unit_length(&mut features, total);
    }
    let loss = options.loss.then_some(loss.loss / loss.of_zeros);
    let Rows { seen, coverage, .. } = rows;
    Ok(Lifted { features, channels: total, seen, coverage, passes: most, loss })
}

/// Divides the rows of `[N, channels]` by their lengths, or by 1e-6 if they are shorter.
pub fn to_unit_length<T: Real>(rows: &mut [T], channels: usize) {
    for_rows(rows, channels, |_, row| {
        let length = row.iter().map(|x| x.to_f64() * x.to_f64()).sum::<f64>().sqrt().max(1e-6);
        row.iter_mut().for_each(|x| *x = T::from_f64(x.to_f64() / length));
    });
}
