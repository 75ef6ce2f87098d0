//! Gaussians chosen, joined, and brought to another degree.

use crate::Gaussians;
use std::ops::Range;
use weaver_geometry::sh;

impl Gaussians {
    /// The Gaussians of these numbers, in their order; a number may come several times.
    ///
    /// # Panics
    /// When a number is not below [`Gaussians::len`].
    ///
    /// ```
    /// use weaver_scene::Gaussians;
    /// let two = Gaussians {
    ///     means: vec![[0.0; 3], [1.0; 3]],
    ///     log_scales: vec![[-3.0; 3]; 2],
    ///     quats: vec![[1.0, 0.0, 0.0, 0.0]; 2],
    ///     opacity_logits: vec![0.0, 2.0],
    ///     sh: vec![0.0; 6],
    ///     degree: 0,
    /// };
    /// assert_eq!(two.select(&[1]).opacity_logits, [2.0]);
    /// ```
    pub fn select(&self, numbers: &[usize]) -> Self {
        let k = 3 * self.coefficients();
        Self {
            means: numbers.iter().map(|&i| self.means[i]).collect(),
            log_scales: numbers.iter().map(|&i| self.log_scales[i]).collect(),
            quats: numbers.iter().map(|&i| self.quats[i]).collect(),
            opacity_logits: numbers.iter().map(|&i| self.opacity_logits[i]).collect(),
            sh: numbers.iter().flat_map(|&i| &self.sh[i * k..][..k]).copied().collect(),
            degree: self.degree,
        }
    }

    /// The Gaussians with harmonics up to `degree`: those beyond are left out, those that are missing are zero.
    ///
    /// # Panics
    /// When `degree` is above 4.
    pub fn with_degree(&self, degree: usize) -> Self {
        assert!(degree <= sh::MAX_DEGREE, "with_degree: expected a degree up to {}, found {degree}", sh::MAX_DEGREE);
        if degree == self.degree {
            return self.clone();
        }
        let (from, to) = (3 * self.coefficients(), 3 * sh::coefficients(degree));
        let mut harmonics = vec![0.0; self.len() * to];
        for (to, from) in harmonics.chunks_exact_mut(to).zip(self.sh.chunks_exact(from)) {
            let kept = to.len().min(from.len());
            to[..kept].copy_from_slice(&from[..kept]);
        }
        Self {
            means: self.means.clone(),
            log_scales: self.log_scales.clone(),
            quats: self.quats.clone(),
            opacity_logits: self.opacity_logits.clone(),
            sh: harmonics,
            degree,
        }
    }

    /// The Gaussians of consecutive numbers.
    ///
    /// # Panics
    /// When `rows` lead beyond [`Gaussians::len`].
    pub fn slice(&self, rows: Range<usize>) -> Self {
        let k = 3 * self.coefficients();
        Self {
            means: self.means[rows.clone()].to_vec(),
            log_scales: self.log_scales[rows.clone()].to_vec(),
            quats: self.quats[rows.clone()].to_vec(),
            opacity_logits: self.opacity_logits[rows.clone()].to_vec(),
            sh: self.sh[rows.start * k..rows.end * k].to_vec(),
            degree: self.degree,
        }
    }

    /// Appends Gaussians, whose harmonics beyond the degree of these are left out, and whose missing ones are zero.
    pub fn append(&mut self, others: &Self) {
        self.means.extend(&others.means);
        self.log_scales.extend(&others.log_scales);
        self.quats.extend(&others.quats);
        self.opacity_logits.extend(&others.opacity_logits);
        if others.degree == self.degree {
            self.sh.extend(&others.sh);
        } else {
            self.sh.extend(&others.with_degree(self.degree).sh);
        }
    }

    /// The Gaussians of all `parts`, one part after the other, with harmonics up to the largest degree among them.
    pub fn joined(parts: &[Self]) -> Self {
        let degree = parts.iter().map(|part| part.degree).max().unwrap_or(0);
        let mut all = Self { degree, ..Self::default() };
        parts.iter().for_each(|part| all.append(part));
        all
    }
}
