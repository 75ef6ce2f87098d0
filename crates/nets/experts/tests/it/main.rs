//! Integration tests of weaver-experts.

mod gradients;
mod head;
mod layouts;
mod neighbors;
mod parity;
mod reference;
