//! Integration tests across crates; the tests themselves are in `it/`.

/// The walk-through of docs/contribute/add-an-op.md, compiled and run from here: from another crate.
#[cfg(doctest)]
#[doc = include_str!("../../docs/contribute/add-an-op.md")]
pub struct AddAnOp;

/// The examples of docs/contribute/crates.md.
#[cfg(doctest)]
#[doc = include_str!("../../docs/contribute/crates.md")]
pub struct Crates;
