//! Integration tests.

mod bundle;
mod estimate;
mod features;
mod one_place;
mod refine;
mod rigs;
mod tracks;
mod two_view;
