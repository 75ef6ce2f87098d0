// What passes share about how they are dispatched.

// No count exceeds this: a drawing of so many entries is refused, and addition that stops here is still associative.
const MOST: u32 = 0x7fffffffu;

// The work group of a dispatch, which is folded into two dimensions where one would not do.
fn group_index(group: vec3<u32>, groups: vec3<u32>) -> u32 {
    return group.y * groups.x + group.x;
}
