//! Integration tests.

mod bundle;
mod features;
mod refine;
mod tracks;
mod two_view;
