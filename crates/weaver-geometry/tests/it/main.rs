//! Integration tests.

mod align;
mod lie;
mod poses;
mod sh;
mod strategies;
mod trajectory;
