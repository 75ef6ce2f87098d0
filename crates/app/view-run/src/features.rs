//! Features of Gaussians, and their similarity.

/// Features of the Gaussians of a scene, compared by their directions.
#[derive(Clone, Debug)]
pub struct Features {
    channels: usize,
    /// `[Gaussians, channels]`, each of length 1, or of zeros.
    rows: Vec<f32>,
}

impl Features {
    /// Features `[Gaussians, channels]`; the length of each does not matter.
    ///
    /// # Panics
    /// When there are no channels.
    pub fn new(mut rows: Vec<f32>, channels: usize) -> Self {
        for row in rows.chunks_exact_mut(channels) {
            let length = row.iter().map(|x| x * x).sum::<f32>().sqrt();
            let scale = if length > 0.0 && length.is_finite() { length.recip() } else { 0.0 };
            row.iter_mut().for_each(|x| *x *= scale);
        }
        Self { channels, rows }
    }

    /// The cosines of the angles between the features of a Gaussian and of each one: 255 for 1, 0 for 0 and below. None
    /// where there is no Gaussian of this number.
    ///
    /// ```
    /// let features = weaver_view_run::Features::new(vec![1.0, 0.0, 0.0, 2.0, 3.0, 3.0, -1.0, 0.0], 2);
    /// assert_eq!(features.alike(0), Some(vec![255, 0, 180, 0]));
    /// assert_eq!(features.alike(4), None);
    /// ```
    pub fn alike(&self, gaussian: usize) -> Option<Vec<u8>> {
        let rows = || self.rows.chunks_exact(self.channels);
        let wanted = rows().nth(gaussian)?;
        let cosine = |row: &[f32]| row.iter().zip(wanted).map(|(a, b)| a * b).sum::<f32>();
        Some(rows().map(|row| (255.0 * cosine(row)).round().clamp(0.0, 255.0) as u8).collect())
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.rows.len() / self.channels
    }

    /// True if there are no Gaussians.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }
}
