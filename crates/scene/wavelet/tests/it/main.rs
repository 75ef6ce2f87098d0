//! Tests of the wavelet ops.

mod adjoint;
mod fixture;
mod mechanism;
mod parity;
