//! Automation for the workspace: `cargo xtask check`.

fn main() {}
