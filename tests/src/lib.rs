//! Integration tests across crates; the tests themselves are in `it/`.

/// The walk-through of docs/add-an-op.md, compiled and run from here: from another crate.
#[cfg(doctest)]
#[doc = include_str!("../../docs/add-an-op.md")]
pub struct AddAnOp;

/// The examples of docs/crates.md.
#[cfg(doctest)]
#[doc = include_str!("../../docs/crates.md")]
pub struct Crates;
