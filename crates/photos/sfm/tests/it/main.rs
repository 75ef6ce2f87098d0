//! Integration tests.

mod bundle;
mod estimate;
mod features;
mod one_place;
mod refine;
mod rigs;
mod second_look;
mod tracks;
mod two_view;
