//! Rates of Adam for the numbers of Gaussians.

/// Rates of Adam: the approximate change of each number in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Centers, x and y, pixels.
    pub center: [f32; 2],
    /// Scales, pixels.
    pub scale: f32,
    /// Angles, radians; of the published method, their logits.
    pub angle: f32,
    /// Colors.
    pub color: f32,
}

impl Rates {
    /// The rates times a factor.
    pub fn times(&self, factor: f32) -> Self {
        Self {
            center: self.center.map(|rate| factor * rate),
            scale: factor * self.scale,
            angle: factor * self.angle,
            color: factor * self.color,
        }
    }
}
