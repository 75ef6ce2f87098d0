//! Tests of the crate's public interface.

mod cameras;
mod edits;
mod gaussians;
