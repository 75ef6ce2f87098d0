//! Tests of the wavelet ops.

mod adjoint;
mod mechanism;
mod parity;
