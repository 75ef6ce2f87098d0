//! Maps without holes: values of some pixels, carried to all others.

use weaver_kernels::parallel;

/// Confidence of a filled pixel over the confidence on the next coarser level.
const DECAY: f32 = 0.5;

/// A map with a value for every pixel, and how near the known ones are.
#[derive(Clone, Debug, PartialEq)]
pub struct Filled {
    /// Values `[V, H, W]`: known ones as they were, others a smooth continuation.
    pub values: Vec<f32>,
    /// 1 at known pixels; elsewhere halved for each doubling of the distance to known ones; 0 in a view without any.
    pub confidence: Vec<f32>,
}

/// One level of the pyramid of a view.
struct Level {
    width: usize,
    /// Means of the known values below each pixel.
    values: Vec<f32>,
    /// Part of what lies below each pixel that is known, 0 to 1.
    weights: Vec<f32>,
}

impl Level {
    fn height(&self) -> usize {
        self.values.len() / self.width
    }

    /// The next coarser level: means of 2 x 2 pixels.
    fn coarser(&self) -> Self {
        let (height, width) = (self.height(), self.width);
        let mut coarser = Self { width: width.div_ceil(2), values: Vec::new(), weights: Vec::new() };
        for (row, column) in (0..height.div_ceil(2)).flat_map(|y| (0..coarser.width).map(move |x| (y, x))) {
            let (mut sum, mut weight) = (0.0, 0.0);
            for y in 2 * row..(2 * row + 2).min(height) {
                for x in 2 * column..(2 * column + 2).min(width) {
                    let at = y * width + x;
                    sum += self.weights[at] * self.values[at];
                    weight += self.weights[at];
                }
            }
            coarser.values.push(if weight > 0.0 { sum / weight } else { 0.0 });
            coarser.weights.push(weight.min(1.0));
        }
        coarser
    }

    /// Fills what is not known from the filled next coarser level, interpolated; returns the confidence.
    fn fill_from(&mut self, coarser: &Self, confidence: &[f32]) -> Vec<f32> {
        let (width, wide, high) = (self.width, coarser.width, coarser.height());
        let split = |at: usize, length: usize| {
            let x = ((at as f32 + 0.5) / 2.0 - 0.5).clamp(0.0, (length - 1) as f32);
            let low = x as usize;
            (low, (low + 1).min(length - 1), x - low as f32)
        };
        let mut own = Vec::with_capacity(self.values.len());
        for (at, (value, weight)) in self.values.iter_mut().zip(&self.weights).enumerate() {
            let ((top, bottom, fy), (left, right, fx)) = (split(at / width, high), split(at % width, wide));
            let mix = |map: &[f32]| {
                let row = |y: usize| map[y * wide + left] * (1.0 - fx) + map[y * wide + right] * fx;
                row(top) * (1.0 - fy) + row(bottom) * fy
            };
            *value = weight * *value + (1.0 - weight) * mix(&coarser.values);
            own.push(weight + (1.0 - weight) * DECAY * mix(confidence));
        }
        own
    }
}

/// Carries the values of known pixels of maps `[V, H, W]` to all others, view by view: means over ever larger squares
/// are interpolated back where nothing finer is known.
///
/// `known` `[V, H, W]`: values elsewhere have no effect. A view without known pixels gets the value `otherwise`.
/// Source: Gortler et al., The Lumigraph, 1996, section 3.4 (pull and push).
///
/// ```
/// use weaver_photo::filled;
/// let map = filled(&[1.0, 9.0, 9.0, 3.0], &[true, false, false, true], [1, 4], 0.0);
/// assert!(map.values[0] == 1.0 && map.values[1] < map.values[2] && map.values[3] == 3.0);
/// assert!(map.confidence[0] == 1.0 && map.confidence[1] < 1.0);
/// ```
///
/// # Panics
/// When sizes do not fit.
pub fn filled(values: &[f32], known: &[bool], [height, width]: [usize; 2], otherwise: f32) -> Filled {
    let pixels = height * width;
    assert!(values.len() == known.len() && values.len().is_multiple_of(pixels.max(1)), "maps [V, {height}, {width}]");
    let mut all = Filled { values: values.to_vec(), confidence: vec![0.0; values.len()] };
    let mut both: Vec<_> = all.values.chunks_mut(pixels).zip(all.confidence.chunks_mut(pixels)).collect();
    parallel::for_chunks(&mut both, 1, |view, maps| {
        let (to, confidence) = &mut maps[0];
        let known = &known[view * pixels..][..pixels];
        if !known.contains(&true) {
            to.fill(otherwise);
            return;
        }
        let weights = known.iter().map(|known| f32::from(u8::from(*known))).collect();
        let mut levels = vec![Level { width, values: to.to_vec(), weights }];
        while levels.last().is_some_and(|level| level.values.len() > 1) {
            levels.extend(levels.last().map(Level::coarser));
        }
        let Some(mut coarser) = levels.pop() else { return };
        let mut found = coarser.weights.clone();
        while let Some(mut level) = levels.pop() {
            found = level.fill_from(&coarser, &found);
            coarser = level;
        }
        to.copy_from_slice(&coarser.values);
        confidence.copy_from_slice(&found);
    });
    all
}
