//! The binary as a process: exit codes, signals, pipes, and what it starts itself.

mod plan;
mod process;
mod video;
