//! The rate of a video: `--fps`.

/// Pictures per second.
pub fn rate(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(rate) if (0.1..=1000.0).contains(&rate) => Ok(rate),
        _ => Err("expected a number from 0.1 to 1000".into()),
    }
}
