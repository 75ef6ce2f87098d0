//! Tests of lifting.

mod aggregate;
mod clusters;
mod fixture;
mod identities;
mod parity;
mod random;
mod raster;
mod refusals;
