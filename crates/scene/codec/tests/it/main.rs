//! Tests of the codec.

mod codebook;
mod coder;
mod container;
mod lite;
mod rates;
mod space;
