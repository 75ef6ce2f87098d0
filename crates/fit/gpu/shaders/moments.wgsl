// Pass: what each splat receives from the pixels of a tile, two entries a thread. The threads walk over the pixels one behind the
// other, so that each pixel sees the entries front to back, and each entry keeps its sums in registers: one row, one writer.

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

const THREADS: u32 = 64u;
// Entries that walk together.
const ENTRIES: u32 = 2u * THREADS;
const PIXELS: u32 = 256u;

// Of each pixel: transmittance, negative where the pixel has ended; rest; and its cotangents of color and depth.
var<workgroup> light: array<vec2<f32>, PIXELS>;
var<workgroup> dpixel: array<vec4<f32>, PIXELS>;
var<workgroup> ended: atomic<u32>;
var<workgroup> all_ended: bool;

// What a thread knows of one of its splats.
struct Entry {
    // Its row; none if this is not present.
    row: u32,
    present: bool,
    center: vec2<f32>,
    pq: vec2<f32>,
    r: f32,
    opacity: f32,
    // Red, green, blue, Z.
    value: vec4<f32>,
}

// Sums over the pixels.
struct Sums {
    // G, Gu, Gv, Guu.
    shape: vec4<f32>,
    // Guv, Gvv.
    second: vec2<f32>,
    // Of w times the cotangents.
    value: vec4<f32>,
    pull: vec2<f32>,
    // sum w, max w.
    weight: vec2<f32>,
}

fn entry_at(place: u32, end: u32) -> Entry {
    var entry = Entry();
    if (place < end) {
        entry.row = entries[place];
        let n = owners[entry.row];
        let a = splats[4u * n];
        let b = splats[4u * n + 1u];
        entry.present = true;
        entry.center = a.xy;
        entry.pq = a.zw;
        entry.r = b.x;
        entry.opacity = b.y;
        entry.value = vec4<f32>(splats[4u * n + 2u].xyz, b.w);
    }
    return entry;
}

// What the splat receives from a pixel, and what it leaves of the pixel's light to those behind.
fn meet(entry: Entry, middle: vec2<f32>, d: vec4<f32>, before: vec2<f32>, sums: ptr<function, Sums>) -> vec2<f32> {
    let sample = sample_at(entry.center, entry.pq, entry.r, entry.opacity, middle);
    let alpha = min(view.alpha_max, sample.raw);
    // Nothing is seen by a pixel that has ended, nor of an entry that is not there: its opacity is zero.
    if (alpha < ALPHA_MIN || before.x <= 0.0) {
        return before;
    }
    let after = before.x - alpha * before.x;
    if (after <= TRANSMITTANCE_END) {
        return vec2<f32>(-before.x, before.y);
    }
    let weight = alpha * before.x;
    let kappa = weight * dot(d, entry.value);
    let rest = before.y - kappa;
    let g = select(0.0, kappa - alpha / (1.0 - alpha) * rest, view.alpha_max >= sample.raw);
    let gu = g * sample.u;
    let gv = g * sample.v;
    (*sums).shape += vec4<f32>(g, gu, gv, gu * sample.u);
    (*sums).second += vec2<f32>(gu, gv) * sample.v;
    (*sums).value += weight * d;
    (*sums).pull += abs(vec2<f32>(entry.pq.x * gu, entry.pq.y * gu + entry.r * gv));
    (*sums).weight = vec2<f32>((*sums).weight.x + weight, max((*sums).weight.y, weight));
    return vec2<f32>(after, rest);
}

fn store(entry: Entry, sums: Sums) {
    if (entry.present) {
        moments[3u * entry.row] = sums.shape;
        moments[3u * entry.row + 1u] = vec4<f32>(sums.second, sums.value.xy);
        moments[3u * entry.row + 2u] = vec4<f32>(sums.value.zw, sums.pull / (BITS * BITS));
        if (view.statistics != 0u) {
            weights[entry.row] = sums.weight;
        }
    }
}

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
    for (var i = lane; i < PIXELS; i += THREADS) {
        begin_pixel(tile, i);
    }
    let corner = vec2<f32>(corner_of(tile)) + 0.5;
    for (var at = begin; at < end; at += ENTRIES) {
        workgroupBarrier();
        if (lane == 0u) {
            all_ended = atomicLoad(&ended) == PIXELS;
        }
        let nothing_left = workgroupUniformLoad(&all_ended);
        let front = entry_at(at + 2u * lane, end);
        let back = entry_at(at + 2u * lane + 1u, end);
        var front_sums = Sums();
        var back_sums = Sums();
        // Where no pixel is open there is nothing to add.
        let steps = select(PIXELS + THREADS - 1u, 0u, nothing_left);
        for (var step = 0u; step < steps; step++) {
            // Below zero it wraps to beyond all pixels.
            let i = step - lane;
            if (front.present && i < PIXELS) {
                let before = light[i];
                if (before.x > 0.0) {
                    let d = dpixel[i];
                    let middle = corner + vec2<f32>(f32(i % SIDE), f32(i / SIDE));
                    let between = meet(front, middle, d, before, &front_sums);
                    let after = meet(back, middle, d, between, &back_sums);
                    light[i] = after;
                    if (after.x < 0.0) {
                        atomicAdd(&ended, 1u);
                    }
                }
            }
            workgroupBarrier();
        }
        store(front, front_sums);
        store(back, back_sums);
    }
}
