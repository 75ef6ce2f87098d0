//! Tests of the crate as a whole.

mod cloud;
mod oracles;
mod planted;
mod refusals;
