//! Integration tests of weaver-experts.

mod fixture;
mod gradients;
mod head;
mod neighbors;
mod parity;
mod reference;
