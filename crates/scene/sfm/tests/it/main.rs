//! Integration tests.

mod bundle;
mod estimate;
mod features;
mod refine;
mod tracks;
mod two_view;
