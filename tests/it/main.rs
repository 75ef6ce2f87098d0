//! The command line from end to end: what it makes, and what it says to bad input.

mod bench;
mod capture;
mod checkpoints;
mod command;
mod configuration;
mod divergence;
mod documents;
mod fit;
mod flags;
mod given_cameras;
mod help;
mod info;
mod inputs;
mod left_behind;
mod lpips;
mod masks;
mod photos;
mod published;
mod render;
mod run;
mod serde;
mod teacher;
mod two_experts;
mod walkthrough;
mod weights;
mod wild;
