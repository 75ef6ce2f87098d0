//! Tests of the parts for studies only.

mod alternatives;
#[allow(dead_code, reason = "the router's own tests need more of it")]
#[path = "../../../dynamic/tests/it/routed.rs"]
mod routed;
#[allow(dead_code, reason = "the router's own tests need more of it")]
#[path = "../../../dynamic/tests/it/wall.rs"]
mod wall;
