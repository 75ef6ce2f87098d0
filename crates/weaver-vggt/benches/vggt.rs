//! Benchmarks of the backbone.

fn main() {}
