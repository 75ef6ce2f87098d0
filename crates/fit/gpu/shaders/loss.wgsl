// Passes: (1 - w) mean |image - photo| + w (1 - SSIM), and its gradient: window_rows, window_maps, spread_maps, compare, sum_losses.
//
// SSIM is a mean over windows of 11 x 11 pixels inside the image, of one fraction for each window, made of five weighted means (Wang
// and others, 2004). The weights are a product of one along x and one along y, so that means are taken first along rows, then
// down; and what each window gives its pixels back is spread in the same two steps.

struct Loss {
    background: vec3<f32>,
    // What 1 - SSIM counts by, over the number of windows and channels; 0 where the image is smaller than a window.
    ssim_slope: f32,
    // Weights of the window up to the middle one.
    taps: array<vec4<f32>, 2>,
    width: u32,
    height: u32,
    // What |image - photo| counts by, over the numbers of the image.
    l1_slope: f32,
    // Sums of work groups.
    parts: u32,
}

@group(0) @binding(0) var<uniform> loss: Loss;
// Red, green, blue, depth, transmittance, as composite leaves them.
@group(0) @binding(1) var<storage, read> pixels: array<f32>;
// Four bytes a pixel: red, green, blue, and 0 where the photo does not count.
@group(0) @binding(2) var<storage, read> photo: array<u32>;
// [H, w] of fifteen numbers: means along x of a, b, aa, bb, ab, three channels each; then of nine: maps spread down.
@group(0) @binding(3) var<storage, read_write> rows: array<f32>;
// [h, w] of nine numbers: derivatives of a window's similarity by its means of a, aa, ab.
@group(0) @binding(4) var<storage, read_write> maps: array<f32>;
@group(0) @binding(5) var<storage, read_write> cotangents: array<f32>;
// Of each group: |image - photo|, 1 - similarity, squared difference.
@group(0) @binding(6) var<storage, read_write> parts: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> losses: array<f32>;

const WINDOW: u32 = 11u;
const BORDER: u32 = 10u;
const C1: f32 = 1e-4;
const C2: f32 = 9e-4;
// Taken off before squaring: variances stay the same, and lose fewer digits.
const CENTER: f32 = 0.5;

fn tap(k: u32) -> f32 {
    let i = min(k, BORDER - k);
    return loss.taps[i / 4u][i % 4u];
}

// A pixel as drawn and as in the photo. Where the photo does not count, both are as drawn: no difference.
struct Pair {
    drawn: vec3<f32>,
    photo: vec3<f32>,
    counts: bool,
}

fn pair_at(i: u32) -> Pair {
    let color = vec3<f32>(pixels[5u * i], pixels[5u * i + 1u], pixels[5u * i + 2u]);
    let drawn = color + pixels[5u * i + 4u] * loss.background;
    let seen = unpack4x8unorm(photo[i]);
    if (seen.w > 0.0) {
        return Pair(drawn, seen.xyz, true);
    }
    let inside = clamp(drawn, vec3<f32>(0.0), vec3<f32>(1.0));
    return Pair(inside, inside, false);
}

fn row_at(i: u32) -> vec3<f32> {
    return vec3<f32>(rows[i], rows[i + 1u], rows[i + 2u]);
}

fn map_at(i: u32) -> vec3<f32> {
    return vec3<f32>(maps[i], maps[i + 1u], maps[i + 2u]);
}

fn put_row(i: u32, x: vec3<f32>) {
    rows[i] = x.x;
    rows[i + 1u] = x.y;
    rows[i + 2u] = x.z;
}

fn put_map(i: u32, x: vec3<f32>) {
    maps[i] = x.x;
    maps[i + 1u] = x.y;
    maps[i + 2u] = x.z;
}

var<workgroup> halves: array<vec4<f32>, 128>;

// The sum over the work group, in thread 0: the upper half hands its sums to the lower one.
fn sum_of(lane: u32, x: vec4<f32>) -> vec4<f32> {
    var sum = x;
    for (var half = 128u; half > 0u; half /= 2u) {
        if (lane >= half && lane < 2u * half) {
            halves[lane - half] = sum;
        }
        workgroupBarrier();
        if (lane < half) {
            sum += halves[lane];
        }
        workgroupBarrier();
    }
    return sum;
}

@compute @workgroup_size(256)
fn window_rows(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = group_index(group, groups) * 256u + lane;
    let w = loss.width - BORDER;
    if (i >= loss.height * w) {
        return;
    }
    let first = i / w * loss.width + i % w;
    var a = vec3<f32>(0.0);
    var b = vec3<f32>(0.0);
    var aa = vec3<f32>(0.0);
    var bb = vec3<f32>(0.0);
    var ab = vec3<f32>(0.0);
    for (var k = 0u; k < WINDOW; k++) {
        let pair = pair_at(first + k);
        let x = pair.drawn - CENTER;
        let y = pair.photo - CENTER;
        a += tap(k) * x;
        b += tap(k) * y;
        aa += tap(k) * (x * x);
        bb += tap(k) * (y * y);
        ab += tap(k) * (x * y);
    }
    put_row(15u * i, a);
    put_row(15u * i + 3u, b);
    put_row(15u * i + 6u, aa);
    put_row(15u * i + 9u, bb);
    put_row(15u * i + 12u, ab);
}

@compute @workgroup_size(256)
fn window_maps(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = group_index(group, groups);
    let i = g * 256u + lane;
    let w = loss.width - BORDER;
    let count = (loss.height - BORDER) * w;
    var dissimilarity = 0.0;
    if (i < count) {
        var a = vec3<f32>(0.0);
        var b = vec3<f32>(0.0);
        var aa = vec3<f32>(0.0);
        var bb = vec3<f32>(0.0);
        var ab = vec3<f32>(0.0);
        for (var k = 0u; k < WINDOW; k++) {
            let at = 15u * (i + k * w);
            a += tap(k) * row_at(at);
            b += tap(k) * row_at(at + 3u);
            aa += tap(k) * row_at(at + 6u);
            bb += tap(k) * row_at(at + 9u);
            ab += tap(k) * row_at(at + 12u);
        }
        let mean_a = a + CENTER;
        let mean_b = b + CENTER;
        let variances = (aa - a * a) + (bb - b * b);
        let covariance = ab - a * b;
        let brightness_scale = 1.0 / (mean_a * mean_a + mean_b * mean_b + C1);
        let brightness = (2.0 * mean_a * mean_b + C1) * brightness_scale;
        let structure_scale = 1.0 / (variances + C2);
        let structure = (2.0 * covariance + C2) * structure_scale;
        let by_aa = -brightness * structure * structure_scale;
        let by_ab = 2.0 * brightness * structure_scale;
        let by_mean = 2.0 * structure * (mean_b - mean_a * brightness) * brightness_scale;
        put_map(9u * i, by_mean - 2.0 * a * by_aa - b * by_ab);
        put_map(9u * i + 3u, by_aa);
        put_map(9u * i + 6u, by_ab);
        dissimilarity = dot(1.0 - brightness * structure, vec3<f32>(1.0));
    }
    let sum = sum_of(lane, vec4<f32>(0.0, dissimilarity, 0.0, 0.0));
    if (lane == 0u && i < count) {
        parts[g] = sum;
    }
}

@compute @workgroup_size(256)
fn spread_maps(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = group_index(group, groups) * 256u + lane;
    let w = loss.width - BORDER;
    if (i >= loss.height * w) {
        return;
    }
    let y = i / w;
    var a = vec3<f32>(0.0);
    var aa = vec3<f32>(0.0);
    var ab = vec3<f32>(0.0);
    for (var k = 0u; k < WINDOW; k++) {
        if (y >= k && y - k < loss.height - BORDER) {
            let at = 9u * (i - k * w);
            a += tap(k) * map_at(at);
            aa += tap(k) * map_at(at + 3u);
            ab += tap(k) * map_at(at + 6u);
        }
    }
    put_row(9u * i, a);
    put_row(9u * i + 3u, aa);
    put_row(9u * i + 6u, ab);
}

@compute @workgroup_size(256)
fn compare(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = group_index(group, groups);
    let i = g * 256u + lane;
    let here = i < loss.width * loss.height;
    var sums = vec4<f32>(0.0);
    if (here) {
        let pair = pair_at(i);
        let difference = pair.drawn - pair.photo;
        var d = loss.l1_slope * sign(difference);
        if (loss.ssim_slope != 0.0) {
            let w = loss.width - BORDER;
            let x = i % loss.width;
            var a = vec3<f32>(0.0);
            var aa = vec3<f32>(0.0);
            var ab = vec3<f32>(0.0);
            for (var k = 0u; k < WINDOW; k++) {
                if (x >= k && x - k < w) {
                    let at = 9u * (i / loss.width * w + x - k);
                    a += tap(k) * row_at(at);
                    aa += tap(k) * row_at(at + 3u);
                    ab += tap(k) * row_at(at + 6u);
                }
            }
            d -= loss.ssim_slope * (a + 2.0 * (pair.drawn - CENTER) * aa + (pair.photo - CENTER) * ab);
        }
        d = select(vec3<f32>(0.0), d, pair.counts);
        cotangents[5u * i] = d.x;
        cotangents[5u * i + 1u] = d.y;
        cotangents[5u * i + 2u] = d.z;
        cotangents[5u * i + 3u] = 0.0;
        cotangents[5u * i + 4u] = 0.0;
        let inside = clamp(pair.drawn, vec3<f32>(0.0), vec3<f32>(1.0)) - pair.photo;
        sums = vec4<f32>(dot(abs(difference), vec3<f32>(1.0)), 0.0, dot(inside, inside), 0.0);
    }
    let sum = sum_of(lane, sums);
    if (lane == 0u && here) {
        // Behind the parts of the windows.
        parts[loss.parts - (loss.width * loss.height + 255u) / 256u + g] = sum;
    }
}

@compute @workgroup_size(64)
fn sum_losses(@builtin(local_invocation_index) lane: u32) {
    if (lane >= 3u) {
        return;
    }
    var sum = 0.0;
    for (var part = 0u; part < loss.parts; part++) {
        sum += parts[part][lane];
    }
    losses[lane] = sum;
}
