//! Integration tests of weaver-data.

mod procedural;
