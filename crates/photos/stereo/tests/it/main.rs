//! Tests of the crate as who embeds it sees it.

mod planted;
mod promises;
