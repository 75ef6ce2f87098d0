//! Gaussians that were removed, by reason.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Gaussians that were removed, by reason.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq, Serialize)]
pub struct Cleaned {
    /// No photo shows them.
    pub unseen: usize,
    /// One of many photos shows them, so that nothing says where they are.
    #[serde(default)]
    pub lone: usize,
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
        self.unseen + self.lone + self.harmful + self.contradicted + self.unneeded
    }

    pub(crate) fn add(&mut self, reason: Reason) {
        match reason {
            Reason::Unseen => self.unseen += 1,
            Reason::Lone => self.lone += 1,
            Reason::Harmful => self.harmful += 1,
            Reason::Contradicted => self.contradicted += 1,
            Reason::Unneeded => self.unneeded += 1,
        }
    }
}

impl fmt::Display for Cleaned {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { unseen, lone, harmful, contradicted, unneeded } = self;
        let count = self.count();
        write!(
            f,
            "{count} Gaussians were removed: {unseen} that no photo shows, {lone} that one photo alone shows, \
             {harmful} that make photos worse, {contradicted} that one photo needs and the others contradict, \
             {unneeded} that photos do without"
        )
    }
}

/// A reason to remove a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reason {
    Unseen,
    Lone,
    Harmful,
    Contradicted,
    Unneeded,
}
