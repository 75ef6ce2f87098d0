//! The `splatweaver` binary.

fn main() {}
