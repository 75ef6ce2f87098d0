//! Tests of the codec.

mod coder;
