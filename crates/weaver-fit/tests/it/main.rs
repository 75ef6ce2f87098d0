//! Integration tests.

mod bits;
mod masks;
mod population;
mod recovery;
mod refusals;
mod scenes;
mod strategies;
