//! Integration tests across crates; the tests themselves are in `tests/`.
