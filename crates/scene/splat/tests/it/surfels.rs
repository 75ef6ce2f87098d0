//! Surfels through a spherical camera: a primitive made of nothing but public parts.

#[path = "../../examples/surfels.rs"]
mod example;

#[test]
fn a_primitive_of_ones_own_passes_gradcheck() {
    (4..8).for_each(example::check);
}
