//! A time: `--minutes`.

/// Minutes, of a fit or of all of a reconstruction.
pub fn minutes(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(minutes) if (0.05..=10_000.0).contains(&minutes) => Ok(minutes),
        _ => Err("expected a number from 0.05 to 10000".into()),
    }
}
