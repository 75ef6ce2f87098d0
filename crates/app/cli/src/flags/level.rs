//! The level of a compressed scene that a fit is made for.

/// A level of `lite` settings, from 0, the finest, to 3.
pub fn level(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(level) if (0.0..=3.0).contains(&level) => Ok(level),
        _ => Err("expected a number from 0 to 3".into()),
    }
}
