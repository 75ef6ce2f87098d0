//! Tests of the parts that only studies need.

mod alternatives;
#[allow(dead_code, reason = "the router's own tests need more of it")]
#[path = "../../../dynamic/tests/it/routed.rs"]
mod routed;
#[allow(dead_code, reason = "the router's own tests need more of it")]
#[path = "../../../dynamic/tests/it/wall.rs"]
mod wall;
