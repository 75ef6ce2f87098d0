//! Differences between two scenes of the same Gaussians.

use crate::Gaussians;
use std::f64::consts::PI;
use weaver_geometry::sh;

/// Differences between Gaussians and their changed versions.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Difference {
    /// Distances between centers, world units.
    pub position: Errors,
    /// Root of the mean squared difference of colors over all directions and the three channels,
    /// `sqrt(sum of squared differences of coefficients / (4 pi) / 3)`; colors go from 0 to 1.
    pub color: Errors,
}

/// Mean and largest of some errors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    /// Their mean.
    pub mean: f64,
    /// The largest.
    pub largest: f64,
}

impl Errors {
    /// Mean and largest of errors, which are not negative; zeros of none.
    fn of(errors: impl Iterator<Item = f64>) -> Self {
        let (mut sum, mut largest, mut count) = (0.0, 0.0_f64, 0_u64);
        for error in errors {
            sum += error;
            largest = largest.max(error);
            count += 1;
        }
        Self { mean: if count == 0 { 0.0 } else { sum / count as f64 }, largest }
    }
}

impl Difference {
    /// The difference of a scene from its parts' differences and counts of Gaussians.
    ///
    /// ```
    /// use weaver_scene::{Difference, Errors};
    /// let part = |mean, largest| Difference { position: Errors { mean, largest }, ..Difference::default() };
    /// let whole = Difference::of_parts([(1, part(4.0, 4.0)), (3, part(0.0, 0.0))]);
    /// assert_eq!(whole.position, Errors { mean: 1.0, largest: 4.0 });
    /// ```
    pub fn of_parts(parts: impl IntoIterator<Item = (usize, Self)>) -> Self {
        let (mut whole, mut count) = (Self::default(), 0);
        for (more, part) in parts {
            count += more;
            // A mean that takes further numbers in (Welford, 1962).
            let share = if more == 0 { 0.0 } else { more as f64 / count as f64 };
            for (whole, part) in [(&mut whole.position, part.position), (&mut whole.color, part.color)] {
                whole.mean += share * (part.mean - whole.mean);
                whole.largest = whole.largest.max(part.largest);
            }
        }
        whole
    }
}

impl Gaussians {
    /// The differences between these Gaussians and others; the i-th of the others came from the i-th of these.
    /// Harmonics that one of both does not have count as zero.
    ///
    /// # Panics
    /// When the numbers of Gaussians differ.
    ///
    /// ```
    /// use weaver_scene::Gaussians;
    /// let one = Gaussians {
    ///     means: vec![[0.0; 3]],
    ///     log_scales: vec![[-3.0; 3]],
    ///     quats: vec![[1.0, 0.0, 0.0, 0.0]],
    ///     opacity_logits: vec![0.0],
    ///     sh: vec![0.0; 3],
    ///     degree: 0,
    /// };
    /// let moved = Gaussians { means: vec![[0.0, 3.0, 4.0]], ..one.clone() };
    /// assert_eq!(one.difference(&moved).position.largest, 5.0);
    /// ```
    pub fn difference(&self, other: &Self) -> Difference {
        assert_eq!(self.len(), other.len(), "difference: as many Gaussians as there were");
        let square = |a: &f32, b: &f32| (f64::from(*a) - f64::from(*b)).powi(2);
        let distance = |(a, b): (&[f32; 3], &[f32; 3])| a.iter().zip(b).map(|(a, b)| square(a, b)).sum::<f64>().sqrt();
        let rows = |gaussians: &Self| 3 * sh::coefficients(gaussians.degree);
        let color = |(a, b): (&[f32], &[f32])| {
            let shared: f64 = a.iter().zip(b).map(|(a, b)| square(a, b)).sum();
            let longer = if a.len() > b.len() { &a[b.len()..] } else { &b[a.len()..] };
            let alone: f64 = longer.iter().map(|x| square(x, &0.0)).sum();
            ((shared + alone) / (12.0 * PI)).sqrt()
        };
        Difference {
            position: Errors::of(self.means.iter().zip(&other.means).map(distance)),
            color: Errors::of(self.sh.chunks_exact(rows(self)).zip(other.sh.chunks_exact(rows(other))).map(color)),
        }
    }
}
