//! The binary as a process: exit codes, signals, pipes, and what it starts itself.

#[cfg(unix)]
mod fit;
mod plan;
mod process;
mod video;
