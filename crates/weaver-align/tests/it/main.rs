//! Tests of the crate as a whole.

mod cloud;
mod descent;
mod oracles;
mod planted;
mod refusals;
