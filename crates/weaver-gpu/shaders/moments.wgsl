// Pass: what each splat receives from the pixels of a tile, a thread per entry. Sixty-four entries walk over the pixels one behind
// the other, so that each pixel sees them front to back, and each entry keeps its sums in registers: one row, one writer.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> owners: array<u32>;
@group(0) @binding(3) var<storage, read> entries: array<u32>;
@group(0) @binding(4) var<storage, read> starts: array<u32>;
@group(0) @binding(5) var<storage, read> pixels: array<f32>;
// With respect to image, alpha and depth: five numbers per pixel.
@group(0) @binding(6) var<storage, read> cotangents: array<f32>;
// Three rows per entry: G, Gu, Gv, Guu; Guv, Gvv, red, green; blue, Z, and the pulls along x and y.
@group(0) @binding(7) var<storage, read_write> moments: array<vec4<f32>>;
// With statistics: sum w and max w.
@group(0) @binding(8) var<storage, read_write> weights: array<vec2<f32>>;

const ENTRIES: u32 = 64u;
const PIXELS: u32 = 256u;

// Of each pixel: transmittance, negative where the pixel has ended; rest; and its cotangents of color and depth.
var<workgroup> light: array<vec2<f32>, PIXELS>;
var<workgroup> dpixel: array<vec4<f32>, PIXELS>;
var<workgroup> ended: atomic<u32>;
var<workgroup> all_ended: bool;

// Puts a pixel at its start: all light, and as rest what the whole list gives.
fn begin_pixel(tile: u32, i: u32) {
    let pixel = corner_of(tile) + vec2<u32>(i % SIDE, i / SIDE);
    if (tile >= view.grid.z * view.grid.w || !in_region(pixel)) {
        light[i] = vec2<f32>(-1.0, 0.0);
        dpixel[i] = vec4<f32>(0.0);
        atomicAdd(&ended, 1u);
        return;
    }
    let at = 5u * place_of(pixel);
    let drawn = vec4<f32>(pixels[at], pixels[at + 1u], pixels[at + 2u], pixels[at + 3u]);
    let d = vec4<f32>(cotangents[at], cotangents[at + 1u], cotangents[at + 2u], cotangents[at + 4u]);
    let total = dot(d, drawn) + pixels[at + 4u] * (dot(d.xyz, view.background) - cotangents[at + 3u]);
    light[i] = vec2<f32>(1.0, total);
    dpixel[i] = d;
}

@compute @workgroup_size(64)
fn sum_moments(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    // The tile behind the last has no pixels: its entries get zeros.
    let tile = group_index(group, groups);
    var begin = 0u;
    var end = 0u;
    if (tile <= view.grid.z * view.grid.w) {
        begin = starts[tile];
        end = starts[tile + 1u];
    }
    if (lane == 0u) {
        atomicStore(&ended, 0u);
    }
    workgroupBarrier();
    for (var i = lane; i < PIXELS; i += ENTRIES) {
        begin_pixel(tile, i);
    }
    let corner = vec2<f32>(corner_of(tile)) + 0.5;
    for (var at = begin; at < end; at += ENTRIES) {
        workgroupBarrier();
        if (lane == 0u) {
            all_ended = atomicLoad(&ended) == PIXELS;
        }
        let nothing_left = workgroupUniformLoad(&all_ended);
        let present = at + lane < end;
        var entry = 0u;
        var a = vec4<f32>(0.0);
        var b = vec4<f32>(0.0);
        var color = vec4<f32>(0.0);
        if (present) {
            entry = entries[at + lane];
            let n = owners[entry];
            a = splats[4u * n];
            b = splats[4u * n + 1u];
            color = vec4<f32>(splats[4u * n + 2u].xyz, b.w);
        }
        var shape = vec4<f32>(0.0);
        var second = vec2<f32>(0.0);
        var tint = vec4<f32>(0.0);
        var pull = vec2<f32>(0.0);
        var weights_here = vec2<f32>(0.0);
        // Where no pixel is open there is nothing to add.
        let steps = select(PIXELS + ENTRIES - 1u, 0u, nothing_left);
        for (var step = 0u; step < steps; step++) {
            // Below zero it wraps to beyond all pixels.
            let i = step - lane;
            if (present && i < PIXELS && light[i].x > 0.0) {
                let middle = corner + vec2<f32>(f32(i % SIDE), f32(i / SIDE));
                let sample = sample_at(a.xy, a.zw, b.x, b.y, middle);
                let alpha = min(view.alpha_max, sample.raw);
                let before = light[i].x;
                let after = before - alpha * before;
                if (alpha >= ALPHA_MIN && after > TRANSMITTANCE_END) {
                    let weight = alpha * before;
                    let d = dpixel[i];
                    let kappa = weight * dot(d, color);
                    let rest = light[i].y - kappa;
                    light[i] = vec2<f32>(after, rest);
                    let g = select(0.0, kappa - alpha / (1.0 - alpha) * rest, view.alpha_max >= sample.raw);
                    let gu = g * sample.u;
                    let gv = g * sample.v;
                    shape += vec4<f32>(g, gu, gv, gu * sample.u);
                    second += vec2<f32>(gu, gv) * sample.v;
                    tint += weight * d;
                    pull += abs(vec2<f32>(a.z * gu, a.w * gu + b.x * gv));
                    weights_here = vec2<f32>(weights_here.x + weight, max(weights_here.y, weight));
                } else if (alpha >= ALPHA_MIN) {
                    light[i].x = -before;
                    atomicAdd(&ended, 1u);
                }
            }
            workgroupBarrier();
        }
        if (present) {
            moments[3u * entry] = shape;
            moments[3u * entry + 1u] = vec4<f32>(second, tint.xy);
            moments[3u * entry + 2u] = vec4<f32>(tint.zw, pull / (BITS * BITS));
            if (view.statistics != 0u) {
                weights[entry] = weights_here;
            }
        }
    }
}
