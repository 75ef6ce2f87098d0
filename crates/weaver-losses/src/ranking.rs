//! Ranking of pixels by high-frequency energy: the router's teacher.

use crate::quantile;
use weaver_autograd::{Pool, Real};

/// The class of every pixel of a scene by the rank of its energy: the number of quantiles that its energy reaches.
///
/// `energy` holds all pixels of all views of one scene, which are ranked jointly; thresholds are its `quantiles`
/// (ascending, linearly interpolated), and an energy equal to a threshold belongs to the upper class. The quantiles 0.76,
/// 0.96, 0.98 thus give classes 0 to 3 to 76, 20, 2 and 2 % of the pixels. A constant: nothing is differentiated.
/// Source: `build_frequency_target` of the official SplatWeaver code.
pub fn frequency_targets<T: Real>(energy: &[T], quantiles: &[f64], pool: &Pool, classes: &mut [u32]) {
    assert_eq!(energy.len(), classes.len(), "frequency_targets: one class per pixel");
    classes.fill(0);
    if energy.is_empty() {
        return;
    }
    let mut scratch = pool.copy_of(energy);
    for &q in quantiles {
        let threshold = quantile(&mut scratch, q);
        for (class, e) in classes.iter_mut().zip(energy) {
            *class += u32::from(*e >= threshold);
        }
    }
}
