//! The Gaussians that are being fitted, with the optimizer's memory of each.

use weaver_geometry::sh::coefficients;
use weaver_scene::{Gaussians, forms};

/// One parameter of all Gaussians, row by row, and Adam's two moments of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Field {
    /// The numbers, `[N, width]`.
    pub values: Vec<f32>,
    /// Running means of the gradients, `[N, width]`.
    pub first: Vec<f32>,
    /// Running means of the squared gradients, `[N, width]`.
    pub second: Vec<f32>,
    width: usize,
}

impl Field {
    /// A parameter without a history.
    pub fn new(values: Vec<f32>, width: usize) -> Self {
        let zeros = vec![0.0; values.len()];
        Self { values, first: zeros.clone(), second: zeros, width }
    }

    /// Numbers per Gaussian.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The numbers of a Gaussian.
    pub fn row(&self, n: usize) -> &[f32] {
        &self.values[n * self.width..][..self.width]
    }

    /// The numbers of a Gaussian, to change.
    pub fn row_mut(&mut self, n: usize) -> &mut [f32] {
        &mut self.values[n * self.width..][..self.width]
    }

    /// Values, first and second moments.
    pub(crate) fn slices(&self) -> [&[f32]; 3] {
        [&self.values, &self.first, &self.second]
    }

    /// Values, first and second moments, to change.
    pub(crate) fn slices_mut(&mut self) -> [&mut [f32]; 3] {
        [&mut self.values, &mut self.first, &mut self.second]
    }

    fn arrays(&mut self) -> [&mut Vec<f32>; 3] {
        [&mut self.values, &mut self.first, &mut self.second]
    }

    /// Forgets the gradients of a Gaussian.
    fn forget(&mut self, n: usize) {
        let rows = n * self.width..(n + 1) * self.width;
        self.first[rows.clone()].fill(0.0);
        self.second[rows].fill(0.0);
    }

    fn retain(&mut self, keep: &[bool]) {
        let width = self.width;
        for array in self.arrays() {
            let mut kept = 0;
            for (n, _) in keep.iter().enumerate().filter(|(_, keep)| **keep) {
                array.copy_within(n * width..(n + 1) * width, kept * width);
                kept += 1;
            }
            array.truncate(kept * width);
        }
    }

    fn duplicate(&mut self, n: usize) {
        let rows = n * self.width..(n + 1) * self.width;
        self.values.extend_from_within(rows);
        self.first.resize(self.values.len(), 0.0);
        self.second.resize(self.values.len(), 0.0);
    }

    fn overwrite(&mut self, to: usize, from: usize) {
        let rows = from * self.width..(from + 1) * self.width;
        self.values.copy_within(rows, to * self.width);
        self.forget(to);
    }

    fn widen(&mut self, width: usize) {
        let old = self.width;
        for array in self.arrays() {
            let mut wide = vec![0.0; array.len() / old * width];
            wide.chunks_exact_mut(width)
                .zip(array.chunks_exact(old))
                .for_each(|(to, from)| to[..old].copy_from_slice(from));
            *array = wide;
        }
        self.width = width;
    }
}

/// `N` Gaussians in stored form (log scales, opacity logits), as an optimizer changes them.
///
/// All changes of their number keep the fields in step. The harmonics hold only the degrees that are in use: those
/// above would be zero, and so would their gradients.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Population {
    /// Centers in world units, `[N, 3]`.
    pub means: Field,
    /// Natural logarithms of the standard deviations, `[N, 3]`.
    pub log_scales: Field,
    /// Rotations, quaternions wxyz of any length, `[N, 4]`.
    pub quats: Field,
    /// Opacities before the sigmoid, `[N, 1]`.
    pub logits: Field,
    /// Spherical harmonics, `[N, 3 K]`.
    pub sh: Field,
    degree: usize,
}

impl Population {
    /// Maps all colors by `[A | b]`, `[3, 4]` row by row.
    pub(crate) fn map_colors(&mut self, map: &[f32; 12]) {
        forms::map_colors(&mut self.sh.values, self.sh.width / 3, map);
    }

    /// Gaussians without a history.
    pub fn new(gaussians: &Gaussians) -> Self {
        Self {
            means: Field::new(gaussians.means.as_flattened().to_vec(), 3),
            log_scales: Field::new(gaussians.log_scales.as_flattened().to_vec(), 3),
            quats: Field::new(gaussians.quats.as_flattened().to_vec(), 4),
            logits: Field::new(gaussians.opacity_logits.clone(), 1),
            sh: Field::new(gaussians.sh.clone(), 3 * gaussians.coefficients()),
            degree: gaussians.degree,
        }
    }

    /// Gaussians that are drawn and not optimized: without the optimizer's memory.
    pub(crate) fn drawn(gaussians: Gaussians) -> Self {
        let field = |values, width| Field { values, width, ..Field::default() };
        let (width, degree) = (3 * gaussians.coefficients(), gaussians.degree);
        Self {
            means: field(gaussians.means.into_flattened(), 3),
            log_scales: field(gaussians.log_scales.into_flattened(), 3),
            quats: field(gaussians.quats.into_flattened(), 4),
            logits: field(gaussians.opacity_logits, 1),
            sh: field(gaussians.sh, width),
            degree,
        }
    }

    /// Sets the numbers of all Gaussians, of the same degree; the optimizer's memory stays.
    pub(crate) fn set(&mut self, gaussians: Gaussians) {
        self.means.values = gaussians.means.into_flattened();
        self.log_scales.values = gaussians.log_scales.into_flattened();
        self.quats.values = gaussians.quats.into_flattened();
        self.logits.values = gaussians.opacity_logits;
        self.sh.values = gaussians.sh;
    }

    #[cfg(feature = "state")]
    pub(crate) fn from_fields([means, log_scales, quats, logits, sh]: [Field; 5], degree: usize) -> Self {
        Self { means, log_scales, quats, logits, sh, degree }
    }

    /// The Gaussians, their harmonics filled up with zeros to `degree`.
    pub fn to_gaussians(&self, degree: usize) -> Gaussians {
        let mut sh = self.sh.clone();
        if degree > self.degree {
            sh.widen(3 * coefficients(degree));
        }
        Gaussians {
            means: self.means.values.as_chunks().0.to_vec(),
            log_scales: self.log_scales.values.as_chunks().0.to_vec(),
            quats: self.quats.values.as_chunks().0.to_vec(),
            opacity_logits: self.logits.values.clone(),
            sh: sh.values,
            degree: degree.max(self.degree),
        }
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.logits.values.len()
    }

    /// True if there are no Gaussians.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Degree of the harmonics in use.
    pub fn degree(&self) -> usize {
        self.degree
    }

    /// Takes harmonics up to a higher degree into use, starting from zero.
    pub fn raise_degree(&mut self, degree: usize) {
        if degree > self.degree {
            self.sh.widen(3 * coefficients(degree));
            self.degree = degree;
        }
    }

    /// The parameters with their names, in a fixed order.
    pub fn fields(&self) -> [(&'static str, &Field); 5] {
        let Self { means, log_scales, quats, logits, sh, .. } = self;
        [("means", means), ("log_scales", log_scales), ("quats", quats), ("logits", logits), ("sh", sh)]
    }

    pub(crate) fn fields_mut(&mut self) -> [&mut Field; 5] {
        let Self { means, log_scales, quats, logits, sh, .. } = self;
        [means, log_scales, quats, logits, sh]
    }

    /// The opacity of a Gaussian.
    pub fn opacity(&self, n: usize) -> f32 {
        forms::opacity(self.logits.values[n])
    }

    /// Sets the opacity of a Gaussian; it is kept inside (0, 1).
    pub fn set_opacity(&mut self, n: usize, opacity: f32) {
        self.logits.values[n] = logit(opacity);
    }

    /// Drops the Gaussians for which `keep` `[N]` is false; the others keep their order.
    pub fn retain(&mut self, keep: &[bool]) {
        assert_eq!(keep.len(), self.len(), "retain: one decision per Gaussian");
        self.fields_mut().into_iter().for_each(|field| field.retain(keep));
    }

    /// Appends a copy of Gaussian `n`, without its history, and returns its index.
    pub fn duplicate(&mut self, n: usize) -> usize {
        self.fields_mut().into_iter().for_each(|field| field.duplicate(n));
        self.len() - 1
    }

    /// Makes Gaussian `to` a copy of Gaussian `from`, without its history.
    pub fn overwrite(&mut self, to: usize, from: usize) {
        self.fields_mut().into_iter().for_each(|field| field.overwrite(to, from));
    }

    /// Forgets the gradients of Gaussian `n`.
    pub fn forget(&mut self, n: usize) {
        self.fields_mut().into_iter().for_each(|field| field.forget(n));
    }

    /// The matrix whose columns are the axes of Gaussian `n` in the world.
    pub fn axes(&self, n: usize) -> [[f32; 3]; 3] {
        let q = self.quats.row(n);
        let length = q.iter().map(|x| x * x).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
        let [w, x, y, z]: [f32; 4] = std::array::from_fn(|i| q[i] / length);
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)],
            [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)],
            [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    }
}

/// The logit of an opacity that is brought inside (0, 1).
pub(crate) fn logit(opacity: f32) -> f32 {
    forms::opacity_logit(opacity.clamp(1e-5, 1.0 - 1e-5))
}
