//! Cached renders of a film's photos by frozen experts, for the training of the router.

use crate::Seen;
use crate::run::RunError;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Most bytes of the cache; further renders are drawn again each time, with the same bits.
const MOST: usize = 1 << 30;

/// Views of photos by the frozen experts, by the photos' number in the film.
#[derive(Debug, Default)]
pub(crate) struct Views {
    kept: BTreeMap<usize, Arc<Seen<f32>>>,
    bytes: usize,
}

impl Views {
    /// The render of a photo, from the cache or drawn by `see`.
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
