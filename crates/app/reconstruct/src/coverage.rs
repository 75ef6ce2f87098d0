//! The part of each photo that other photos show too.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Part of each photo with a depth that two others agree about, by name; empty if it was not measured.
///
/// Surfaces that a single photo shows have no depth that follows from photos.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Coverage(pub BTreeMap<String, f64>);

/// Coverage below which a photo counts as alone.
const ALONE: f64 = 0.1;

impl Coverage {
    /// True if coverage was not measured.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The mean over photos; 0 if it was not measured.
    pub fn mean(&self) -> f64 {
        self.0.values().sum::<f64>() / self.0.len().max(1) as f64
    }

    /// The part of a photo, which may have a path before the name that it has here.
    ///
    /// ```
    /// use weaver_reconstruct::Coverage;
    /// let coverage = Coverage([("images/a.jpg".into(), 0.6), ("b.jpg".into(), 0.02)].into());
    /// assert_eq!(coverage.of("../capture/images/a.jpg"), Some(0.6));
    /// assert_eq!(coverage.of("../capture/aa.jpg"), None);
    /// ```
    pub fn of(&self, name: &str) -> Option<f64> {
        let ends = name.match_indices('/').map(|(at, _)| &name[at + 1..]);
        std::iter::once(name).chain(ends).find_map(|end| self.0.get(end).copied())
    }

    /// Photos that share hardly anything with others.
    ///
    /// ```
    /// use weaver_reconstruct::Coverage;
    /// let coverage = Coverage([("a.jpg".into(), 0.6), ("b.jpg".into(), 0.02)].into());
    /// assert_eq!(coverage.alone(), ["b.jpg"]);
    /// assert_eq!(coverage.mean(), 0.31);
    /// ```
    pub fn alone(&self) -> Vec<&str> {
        self.0.iter().filter(|(_, part)| **part < ALONE).map(|(name, _)| name.as_str()).collect()
    }
}
