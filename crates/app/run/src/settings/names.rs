//! Names that were meant.

/// The candidate most like `name`, if any is like it at all (Jaro-Winkler similarity above 0.7).
///
/// ```
/// assert_eq!(weaver_run::settings::nearest("stpes", ["rate", "steps"]), Some("steps"));
/// assert_eq!(weaver_run::settings::nearest("color", ["rate", "steps"]), None);
/// ```
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    candidates
        .into_iter()
        .map(|c| (strsim::jaro_winkler(name, c), c))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|(likeness, _)| *likeness > 0.7)
        .map(|(_, c)| c)
}
