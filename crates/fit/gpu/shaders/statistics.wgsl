// Pass: what density control decides by, from the same sums; added to those of the views before.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> first: array<u32>;
@group(0) @binding(3) var<storage, read> rank: array<u32>;
@group(0) @binding(4) var<storage, read> moments: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> weights: array<vec2<f32>>;
// Twelve numbers per Gaussian: sums over the bands of this view (Gu, Gv, the pulls, sum w, max w); then over the views screen
// gradient, absgrad, views, radius, contribution, largest weight.
@group(0) @binding(6) var<storage, read_write> statistics: array<f32>;

// Bits of view.statistics.
const FIRST_BAND: u32 = 2u;
const LAST_BAND: u32 = 4u;

// Three standard deviations of the longer axis of S, from S^-1 = L^T L.
fn radius_of(p: f32, q: f32, r: f32) -> f32 {
    // S = L^-1 L^-T with L = [[p, q], [0, r]].
    let a = 1.0 / p;
    let b = q / (p * r);
    let c = 1.0 / r;
    let half_difference = 0.5 * (a * a + b * b - c * c);
    return 3.0 * sqrt(0.5 * (a * a + b * b + c * c) + length(vec2<f32>(half_difference, b * c)));
}

@compute @workgroup_size(256)
fn tally(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let n = group_index(group, groups) * 256u + lane;
    if (n >= view.total) {
        return;
    }
    let to = 12u * n;
    if (view.add == 0u) {
        for (var k = 6u; k < 12u; k++) {
            statistics[to + k] = 0.0;
        }
    }
    var along = vec2<f32>(0.0);
    var pull = vec2<f32>(0.0);
    var weight = vec2<f32>(0.0);
    if ((view.statistics & FIRST_BAND) == 0u) {
        along = vec2<f32>(statistics[to], statistics[to + 1u]);
        pull = vec2<f32>(statistics[to + 2u], statistics[to + 3u]);
        weight = vec2<f32>(statistics[to + 4u], statistics[to + 5u]);
    }
    let place = rank[n];
    for (var entry = first[place]; entry < first[place + 1u]; entry++) {
        along += moments[3u * entry].yz;
        pull += moments[3u * entry + 2u].zw;
        weight = vec2<f32>(weight.x + weights[entry].x, max(weight.y, weights[entry].y));
    }
    if ((view.statistics & LAST_BAND) == 0u) {
        statistics[to] = along.x;
        statistics[to + 1u] = along.y;
        statistics[to + 2u] = pull.x;
        statistics[to + 3u] = pull.y;
        statistics[to + 4u] = weight.x;
        statistics[to + 5u] = weight.y;
    } else if (weight.x > 0.0) {
        // Both factors hold BITS.
        let p = splats[4u * n].z;
        let q = splats[4u * n].w;
        let r = splats[4u * n + 1u].x;
        let dcenter = vec2<f32>(p * along.x, q * along.x + r * along.y) / (BITS * BITS);
        statistics[to + 6u] += sound(length(dcenter));
        statistics[to + 7u] += sound(length(pull));
        statistics[to + 8u] += 1.0;
        statistics[to + 9u] = max(statistics[to + 9u], sound(radius_of(p / BITS, q / BITS, r / BITS)));
        statistics[to + 10u] += weight.x;
        statistics[to + 11u] = max(statistics[to + 11u], weight.y);
    }
}
