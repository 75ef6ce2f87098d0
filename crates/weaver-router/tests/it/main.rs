//! Integration tests of weaver-router.

mod allocation;
mod fixture;
mod gradients;
mod head;
mod neighbors;
mod parity;
mod reference;
