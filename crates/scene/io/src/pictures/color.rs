//! False colors for maps that are not photographs.

use crate::Image;

/// Shows a map `[height, width]` in the colors of viridis: `low` is dark violet, `high` is yellow.
///
/// Values outside are clamped; values that are not finite are black.
///
/// # Panics
/// When `values` is not `height * width` long.
pub fn false_color(values: &[f32], width: usize, height: usize, low: f32, high: f32) -> Image {
    assert_eq!(values.len(), width * height, "a map of {width}x{height}");
    let span = (high - low).max(f32::MIN_POSITIVE);
    let color = |&value: &f32| {
        if !value.is_finite() {
            return [0; 3];
        }
        colorous::VIRIDIS.eval_continuous(f64::from(((value - low) / span).clamp(0.0, 1.0))).as_array()
    };
    let bytes: Vec<u8> = values.iter().flat_map(color).collect();
    Image::from_bytes(width, height, &bytes)
}

/// Shows a map `[height, width]` of labels in ten distinct colors, which repeat from the eleventh label on.
///
/// # Panics
/// When `labels` is not `height * width` long.
pub fn label_color(labels: &[u32], width: usize, height: usize) -> Image {
    assert_eq!(labels.len(), width * height, "a map of {width}x{height}");
    let bytes: Vec<u8> = labels.iter().flat_map(|&l| colorous::TABLEAU10[l as usize % 10].as_array()).collect();
    Image::from_bytes(width, height, &bytes)
}
