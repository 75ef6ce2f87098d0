//! Gaussians that were removed, by reason.

use serde::{Deserialize, Serialize};

/// Gaussians that were removed, by reason.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq, Serialize)]
pub struct Cleaned {
    /// No photo shows them.
    pub unseen: usize,
    /// Photos are met better without them.
    pub harmful: usize,
    /// One photo needs them, and all others are worse with them.
    pub contradicted: usize,
    /// Photos are met as well without them.
    pub unneeded: usize,
}

impl Cleaned {
    /// All that were removed.
    pub fn count(&self) -> usize {
        self.unseen + self.harmful + self.contradicted + self.unneeded
    }

    /// The numbers as a checkpoint has them.
    pub(crate) fn row(self) -> [u64; 4] {
        [self.unseen, self.harmful, self.contradicted, self.unneeded].map(|count| count as u64)
    }

    pub(crate) fn of(row: [u64; 4]) -> Self {
        let [unseen, harmful, contradicted, unneeded] = row.map(|count| count as usize);
        Self { unseen, harmful, contradicted, unneeded }
    }

    pub(crate) fn add(&mut self, reason: Reason) {
        match reason {
            Reason::Unseen => self.unseen += 1,
            Reason::Harmful => self.harmful += 1,
            Reason::Contradicted => self.contradicted += 1,
            Reason::Unneeded => self.unneeded += 1,
        }
    }
}

/// A reason to remove a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reason {
    Unseen,
    Harmful,
    Contradicted,
    Unneeded,
}
