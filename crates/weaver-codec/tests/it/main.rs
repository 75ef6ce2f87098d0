//! Tests of the codec.

mod codebook;
mod coder;
mod container;
mod rates;
mod space;
