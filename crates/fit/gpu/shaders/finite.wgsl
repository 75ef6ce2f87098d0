// Numbers that are not finite.

// Neither infinite nor not a number. Compilers may assume that of numbers, but not of their bits.
fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

fn are_finite(x: vec3<f32>) -> bool {
    return is_finite(x.x) && is_finite(x.y) && is_finite(x.z);
}

// x, or 0 where it is not finite: what overflows on its way to a gradient adds nothing to it.
fn sound(x: f32) -> f32 {
    return select(0.0, x, is_finite(x));
}

fn sound3(x: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(sound(x.x), sound(x.y), sound(x.z));
}
