//! What frozen experts show of a film's photos, kept while the router is trained.

use crate::Seen;
use crate::run::RunError;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Bytes that are kept; what does not fit is drawn whenever it is asked for, with the same bits.
const MOST: usize = 1 << 30;

/// Views of photos by the frozen experts, by the photos' number in the film.
#[derive(Debug, Default)]
pub(crate) struct Views {
    kept: BTreeMap<usize, Arc<Seen<f32>>>,
    bytes: usize,
}

impl Views {
    /// The view of a photo, drawn by `see` unless it was kept.
    pub fn of(
        &mut self,
        shot: usize,
        see: impl FnOnce() -> Result<Seen<f32>, RunError>,
    ) -> Result<Arc<Seen<f32>>, RunError> {
        if let Some(seen) = self.kept.get(&shot) {
            return Ok(seen.clone());
        }
        let seen = Arc::new(see()?);
        if self.bytes + seen.bytes() <= MOST {
            self.bytes += seen.bytes();
            self.kept.insert(shot, seen.clone());
        }
        Ok(seen)
    }
}
