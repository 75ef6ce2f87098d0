//! Valid pixels, and visibility of Gaussians in them.

use crate::error::LiftError;
use crate::observations::Observations;
use crate::operator::Operator;
use crate::statistics::Coverage;
use weaver_kernels::Real;

/// The valid rows of A, with sums over them.
#[derive(Clone, Debug)]
pub struct Rows<T> {
    /// Factors on the features of each view's pixels, `[R_v]`; 0 for masked ones.
    pub(crate) factors: Vec<Vec<T>>,
    /// `D_j = sum_i A_ij`, `[P]`.
    pub(crate) seen: Vec<T>,
    /// `sum_i A_ij^2`, `[P]`.
    pub(crate) squares: Vec<T>,
    pub(crate) coverage: Coverage,
}

impl<T: Real> Rows<T> {
    /// Visits each view once. With `least_alpha`, pixels of less alpha are masked, and the features of the others are
    /// multiplied by their alpha, as if composited over zeros.
    ///
    /// `seen_view` is called after each view.
    ///
    /// # Errors
    /// [`LiftError::AllMasked`] without valid pixels, [`LiftError::NothingSeen`] if no Gaussian reaches a valid pixel,
    /// and errors of operator and observations.
    pub fn new(
        operator: &mut impl Operator<T>,
        observations: &mut impl Observations<T>,
        least_alpha: Option<f64>,
        seen_view: &mut dyn FnMut(),
    ) -> Result<Self, LiftError> {
        if observations.channels() == 0 {
            return Err(LiftError::NoChannels);
        }
        let splats = operator.splats();
        let ones = vec![T::ONE; splats];
        let mut rows = Self {
            factors: Vec::new(),
            seen: vec![T::ZERO; splats],
            squares: vec![T::ZERO; splats],
            coverage: Coverage::default(),
        };
        for view in 0..operator.views() {
            let rays = operator.rays(view);
            let (mut factors, mut alpha) = (vec![T::ZERO; rays], vec![T::ZERO; rays]);
            observations.factors(view, &mut factors)?;
            operator.forward(view, &ones, 1, &mut alpha)?;
            rows.coverage.rays += rays;
            for (factor, &alpha) in factors.iter_mut().zip(&alpha) {
                if *factor == T::ZERO {
                    rows.coverage.masked += 1;
                    continue;
                }
                if let Some(least) = least_alpha {
                    let covered = alpha >= T::from_f64(least);
                    rows.coverage.dropped += usize::from(!covered);
                    *factor = if covered { *factor * alpha } else { T::ZERO };
                }
                if *factor != T::ZERO {
                    rows.coverage.alpha += alpha.to_f64();
                    rows.coverage.alpha_squared += alpha.to_f64() * alpha.to_f64();
                }
            }
            let counts: Vec<T> = factors.iter().map(|f| if *f == T::ZERO { T::ZERO } else { T::ONE }).collect();
            operator.adjoint(view, &counts, 1, &mut rows.seen)?;
            operator.adjoint_squared(view, &counts, 1, &mut rows.squares)?;
            rows.factors.push(factors);
            seen_view();
        }
        if rows.coverage.masked == rows.coverage.rays {
            return Err(LiftError::AllMasked { rays: rows.coverage.rays });
        }
        rows.coverage.squares = rows.squares.iter().map(|x| x.to_f64()).sum();
        rows.coverage.unseen = rows.seen.iter().filter(|d| **d == T::ZERO).count();
        if rows.coverage.unseen == splats {
            return Err(LiftError::NothingSeen { splats });
        }
        Ok(rows)
    }
}
