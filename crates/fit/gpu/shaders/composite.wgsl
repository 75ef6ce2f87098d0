// Pass: blends the lists of the tiles front to back, four pixels a thread, so that a splat is fetched for all four.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> owners: array<u32>;
@group(0) @binding(3) var<storage, read> entries: array<u32>;
@group(0) @binding(4) var<storage, read> starts: array<u32>;
// Red, green, blue, depth, all without background, and the transmittance: five numbers per pixel.
@group(0) @binding(5) var<storage, read_write> pixels: array<f32>;

const THREADS: u32 = 64u;
// Splats that are looked at together.
const BATCH: u32 = 128u;

// Center, p and q; r, opacity, Z; color.
var<workgroup> shape: array<vec4<f32>, BATCH>;
var<workgroup> value: array<vec4<f32>, BATCH>;
var<workgroup> tint: array<vec4<f32>, BATCH>;
// Threads whose pixels have all ended, or are beyond the region.
var<workgroup> ended: atomic<u32>;
var<workgroup> all_ended: bool;

@compute @workgroup_size(64)
fn composite(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let tile = group_index(group, groups);
    let known = tile < view.grid.z * view.grid.w;
    var begin = 0u;
    var end = 0u;
    if (known) {
        begin = starts[tile];
        end = starts[tile + 1u];
    }
    // Four pixels below each other: one vector holds a number of each.
    let top = corner_of(tile) + vec2<u32>(lane % SIDE, 4u * (lane / SIDE));
    let middle = vec2<f32>(top) + 0.5;
    let middles = middle.y + vec4<f32>(0.0, 1.0, 2.0, 3.0);
    var here = vec4<bool>(false);
    for (var i = 0u; i < 4u; i++) {
        here[i] = known && in_region(top + vec2<u32>(0u, i));
    }
    var open = here;
    var transmittance = vec4<f32>(1.0);
    var red = vec4<f32>(0.0);
    var green = vec4<f32>(0.0);
    var blue = vec4<f32>(0.0);
    var depth = vec4<f32>(0.0);
    if (lane == 0u) {
        atomicStore(&ended, 0u);
    }
    workgroupBarrier();
    if (!any(open)) {
        atomicAdd(&ended, 1u);
    }
    for (var at = begin; at < end; at += BATCH) {
        workgroupBarrier();
        if (lane == 0u) {
            all_ended = atomicLoad(&ended) == THREADS;
        }
        if (workgroupUniformLoad(&all_ended)) {
            break;
        }
        let count = min(BATCH, end - at);
        for (var i = lane; i < count; i += THREADS) {
            let n = owners[entries[at + i]];
            let rest = splats[4u * n + 1u];
            shape[i] = splats[4u * n];
            value[i] = vec4<f32>(rest.x, rest.y, rest.w, 0.0);
            tint[i] = splats[4u * n + 2u];
        }
        workgroupBarrier();
        let before = any(open);
        for (var i = 0u; i < count && any(open); i++) {
            let a = shape[i];
            let b = value[i];
            let dx = middle.x - a.x;
            let dy = middles - a.y;
            let u = a.z * dx + a.w * dy;
            let v = b.x * dy;
            let alpha = min(vec4<f32>(view.alpha_max), b.y * exp2(-(u * u + v * v)));
            let seen = open & (alpha >= vec4<f32>(ALPHA_MIN));
            if (any(seen)) {
                let after = transmittance - alpha * transmittance;
                let goes_on = after > vec4<f32>(TRANSMITTANCE_END);
                let adds = seen & goes_on;
                let weight = select(vec4<f32>(0.0), alpha * transmittance, adds);
                let color = tint[i];
                red += weight * color.x;
                green += weight * color.y;
                blue += weight * color.z;
                depth += weight * b.z;
                transmittance = select(transmittance, after, adds);
                open = open & (!seen | goes_on);
            }
        }
        if (before && !any(open)) {
            atomicAdd(&ended, 1u);
        }
    }
    for (var i = 0u; i < 4u; i++) {
        if (here[i]) {
            let to = 5u * place_of(top + vec2<u32>(0u, i));
            pixels[to] = red[i];
            pixels[to + 1u] = green[i];
            pixels[to + 2u] = blue[i];
            pixels[to + 3u] = depth[i];
            pixels[to + 4u] = transmittance[i];
        }
    }
}
