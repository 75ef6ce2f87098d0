//! Tests of lifting.

mod aggregate;
mod clusters;
mod identities;
mod parity;
mod random;
mod raster;
mod refusals;
