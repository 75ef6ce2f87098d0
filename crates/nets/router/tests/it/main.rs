//! Integration tests of weaver-router.

mod allocation;
mod gradients;
mod quadtree;
