// Pass: blends the lists of the tiles front to back, a thread per pixel.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> owners: array<u32>;
@group(0) @binding(3) var<storage, read> entries: array<u32>;
@group(0) @binding(4) var<storage, read> starts: array<u32>;
// Red, green, blue, depth, all without background, and the transmittance: five numbers per pixel.
@group(0) @binding(5) var<storage, read_write> pixels: array<f32>;

// Splats that are looked at together.
const BATCH: u32 = 128u;

// Center, p and q; r, opacity, Z; color.
var<workgroup> shape: array<vec4<f32>, BATCH>;
var<workgroup> value: array<vec4<f32>, BATCH>;
var<workgroup> tint: array<vec4<f32>, BATCH>;
// Pixels that have ended, or are beyond the region.
var<workgroup> ended: atomic<u32>;
var<workgroup> all_ended: bool;

@compute @workgroup_size(256)
fn composite(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let tile = group_index(group, groups);
    var begin = 0u;
    var end = 0u;
    if (tile < view.grid.z * view.grid.w) {
        begin = starts[tile];
        end = starts[tile + 1u];
    }
    let pixel = corner_of(tile) + vec2<u32>(lane % SIDE, lane / SIDE);
    let here = tile < view.grid.z * view.grid.w && in_region(pixel);
    let middle = vec2<f32>(pixel) + 0.5;
    var open = here;
    var transmittance = 1.0;
    var image = vec3<f32>(0.0);
    var depth = 0.0;
    if (lane == 0u) {
        atomicStore(&ended, 0u);
    }
    workgroupBarrier();
    if (!open) {
        atomicAdd(&ended, 1u);
    }
    for (var at = begin; at < end; at += BATCH) {
        workgroupBarrier();
        if (lane == 0u) {
            all_ended = atomicLoad(&ended) == 256u;
        }
        if (workgroupUniformLoad(&all_ended)) {
            break;
        }
        let count = min(BATCH, end - at);
        if (lane < count) {
            let n = owners[entries[at + lane]];
            let rest = splats[4u * n + 1u];
            shape[lane] = splats[4u * n];
            value[lane] = vec4<f32>(rest.x, rest.y, rest.w, 0.0);
            tint[lane] = splats[4u * n + 2u];
        }
        workgroupBarrier();
        for (var i = 0u; i < count && open; i++) {
            let a = shape[i];
            let b = value[i];
            let sample = sample_at(a.xy, a.zw, b.x, b.y, middle);
            let alpha = min(view.alpha_max, sample.raw);
            if (alpha >= ALPHA_MIN) {
                let after = transmittance - alpha * transmittance;
                if (after > TRANSMITTANCE_END) {
                    let weight = alpha * transmittance;
                    image += weight * tint[i].xyz;
                    depth += weight * b.z;
                    transmittance = after;
                } else {
                    open = false;
                    atomicAdd(&ended, 1u);
                }
            }
        }
    }
    if (here) {
        let to = 5u * place_of(pixel);
        pixels[to] = image.x;
        pixels[to + 1u] = image.y;
        pixels[to + 2u] = image.z;
        pixels[to + 3u] = depth;
        pixels[to + 4u] = transmittance;
    }
}
