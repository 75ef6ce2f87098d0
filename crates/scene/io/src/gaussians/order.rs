//! An order of Gaussians in which successive ones are near each other.

/// Bits of a coordinate.
const BITS: u32 = 21;

/// The least and the largest value of three numbers.
pub(crate) type Bounds = [[f32; 2]; 3];

/// The bounds of points; of none, from infinity to minus infinity.
pub(crate) fn bounds(points: &[[f32; 3]]) -> Bounds {
    let mut bounds = [[f32::INFINITY, f32::NEG_INFINITY]; 3];
    for point in points {
        bounds.iter_mut().zip(point).for_each(|(bound, x)| *bound = [bound[0].min(*x), bound[1].max(*x)]);
    }
    bounds
}

/// A point from 0 at the lower bound to 1 at the upper one.
pub(crate) fn within(bounds: &Bounds, at: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| {
        let [least, most] = bounds[i];
        if most > least { ((at[i] - least) / (most - least)).clamp(0.0, 1.0) } else { 0.0 }
    })
}

/// Numbers of points along a Z-order curve through the box of all (Morton, 1966).
pub(crate) fn nearby(points: &[[f32; 3]]) -> Vec<usize> {
    let bounds = bounds(points);
    let code = |i: &usize| {
        let at = within(&bounds, points[*i]).map(|x| (x * ((1 << BITS) - 1) as f32) as u64);
        (0..BITS).fold(0_u64, |code, bit| {
            (0..3).fold(code, |code, axis| code | (at[axis] >> bit & 1) << (3 * bit + axis as u32))
        })
    };
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by_cached_key(code);
    order
}
