//! Integration tests.

mod align;
mod allocation;
mod bits;
mod cameras;
mod cleaning;
mod kept;
mod lens;
mod masks;
mod population;
mod recovery;
mod refusals;
mod rounding;
mod scenes;
mod several_views;
mod strategies;
mod surfaces;
mod thinning;
mod timing;
mod transients;
