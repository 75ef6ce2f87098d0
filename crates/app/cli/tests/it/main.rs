//! The binary as a process: exit codes, signals, pipes, and what it starts itself.

mod align;
#[cfg(unix)]
mod clip;
mod command;
mod compare;
mod convert;
mod device;
mod dynamic;
mod figures;
#[cfg(unix)]
mod fit;
#[cfg(unix)]
mod image;
mod killed;
mod lift;
mod outputs;
mod photos;
mod plan;
mod process;
mod vad;
mod video;
mod view;
