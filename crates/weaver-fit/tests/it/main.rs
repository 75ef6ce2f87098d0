//! Integration tests.

mod bits;
mod cameras;
mod masks;
mod population;
mod recovery;
mod refusals;
mod scenes;
mod strategies;
