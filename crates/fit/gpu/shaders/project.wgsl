// Pass: from Gaussians to splats, their depth keys, and how many tiles each covers.

@group(0) @binding(0) var<uniform> view: View;
// Numbers that may be of any bits.
@group(0) @binding(1) var<storage, read> params: array<u32>;
@group(0) @binding(2) var<storage, read> color: array<u32>;
@group(0) @binding(3) var<storage, read_write> splats: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> ids: array<u32>;
@group(0) @binding(6) var<storage, read_write> tiles: array<u32>;

// Sorts behind every depth.
const UNSEEN: u32 = 0xffffffffu;
// In place of a number of tiles: left out, for a number that is not finite.
const REJECTED: u32 = 0xffffffffu;
// The rounding of f32.
const EPSILON: f32 = 1.1920929e-7;

// Sorts as f32 does.
fn depth_key(z: f32) -> u32 {
    let bits = bitcast<u32>(z);
    return select(bits | 0x80000000u, ~bits, bits >> 31u == 1u);
}

// Three standard deviations along the longest image axis, pixels.
fn three_deviations(s: Projection) -> f32 {
    let mean = 0.5 * (s.variance.x + s.variance.y);
    return 3.0 * sqrt(mean + sqrt(max(mean * mean - s.det, 0.0)));
}

// The splat without its color.
fn splat_of(s: Projection, opacity: f32) -> Splat {
    var splat: Splat;
    let p = s.factor.x * BITS;
    let q = s.factor.y * BITS;
    let r = s.factor.z * BITS;
    // Rounded up by more than what the pixels' own arithmetic may be off by.
    let limit = log2(opacity * 255.0) + 1e-3;
    let radius = sqrt(limit) * (abs(q / r) * (16.0 * EPSILON) + (1.0 + 16.0 * EPSILON));
    splat.width = 1.0 / p;
    let tall = radius / r;
    splat.tilt = q * splat.width;
    splat.center = view.focal * s.free + view.principal;
    let extent = abs(splat.center.x) + abs(splat.center.y) + abs(splat.tilt) * tall + radius * splat.width;
    splat.slack = extent * (8.0 * EPSILON) + 1e-3;
    splat.half_height = tall + splat.slack;
    splat.dy_of_right = -q * radius / (r * sqrt(q * q + r * r));
    splat.pq = vec2<f32>(p, q);
    splat.r = r;
    splat.opacity = opacity;
    splat.depth = s.point.z;
    splat.reach = radius * radius * (1.0 + 8.0 * EPSILON);
    return splat;
}

// The color of Gaussian i toward the camera, and whether its numbers are finite.
struct Toward {
    color: vec3<f32>,
    finite: bool,
}

fn color_of(i: u32, mean: vec3<f32>) -> Toward {
    if (view.color_len == 0u) {
        return Toward(vec3<f32>(0.0), true);
    }
    if (view.terms == 0u) {
        let plain = coefficient(i, 0u);
        return Toward(plain, are_finite(plain));
    }
    let sight = mean - view.center;
    let b = basis_at(view.terms, sight / sqrt(dot(sight, sight)));
    var sum = vec3<f32>(0.5);
    var finite = true;
    for (var k = 0u; k < view.terms; k++) {
        let h = coefficient(i, k);
        finite = finite && are_finite(h);
        sum += b[k].x * h;
    }
    return Toward(max(sum, vec3<f32>(0.0)), finite && are_finite(sum));
}

fn tiles_of(splat: Splat) -> u32 {
    let rows = rows_of(splat);
    var count = 0u;
    for (var row = rows.x; row < rows.y; row++) {
        let columns = columns_of(splat, row);
        count += max(columns.y, columns.x) - columns.x;
    }
    return min(count, MOST);
}

fn store(n: u32, splat: Splat) {
    splats[4u * n] = vec4<f32>(splat.center, splat.pq);
    splats[4u * n + 1u] = vec4<f32>(splat.r, splat.opacity, splat.slack, splat.depth);
    splats[4u * n + 2u] = vec4<f32>(splat.color, splat.half_height);
    splats[4u * n + 3u] = vec4<f32>(splat.dy_of_right, splat.reach, splat.width, splat.tilt);
}

@compute @workgroup_size(256)
fn project(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = group_index(group, groups) * 256u + lane;
    if (i >= view.count) {
        return;
    }
    let n = view.first + i;
    ids[n] = n;
    keys[n] = UNSEEN;
    let gaussian = gaussian_at(i);
    let s = projection_of(gaussian);
    let z = s.point.z;
    if (!gaussian.sound || !is_finite(z) || !is_finite(s.unit.x) || !is_finite(s.inverse_length)) {
        tiles[n] = REJECTED;
        return;
    }
    tiles[n] = 0u;
    let opacity = gaussian.opacity * s.compensation;
    let in_range = z >= view.near && z <= view.far;
    if (!in_range || !(s.det > 0.0) || !(opacity >= ALPHA_MIN) || three_deviations(s) < view.radius_clip) {
        return;
    }
    var splat = splat_of(s, opacity);
    let outline = is_finite(splat.slack) && is_finite(splat.dy_of_right) && is_finite(splat.half_height);
    let toward = color_of(i, gaussian.mean);
    if (!outline || !is_finite(splat.pq.x) || !is_finite(splat.r) || !toward.finite) {
        tiles[n] = REJECTED;
        return;
    }
    splat.color = toward.color;
    store(n, splat);
    let count = tiles_of(splat);
    tiles[n] = count;
    if (count > 0u) {
        keys[n] = depth_key(z);
    }
}
