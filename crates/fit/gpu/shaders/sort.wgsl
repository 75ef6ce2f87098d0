// Passes: one digit of a stable radix sort of (key, value) pairs by ascending key: count, scan, scatter. Four bits a digit.

struct Digit {
    // Pairs, and work groups that share them.
    len: u32,
    groups: u32,
    // Where the digit begins in a key.
    shift: u32,
}

@group(0) @binding(0) var<uniform> digit: Digit;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read> values: array<u32>;
// How often each digit comes in each group, [16, groups]; then where the first of them goes.
@group(0) @binding(3) var<storage, read_write> counts: array<u32>;
@group(0) @binding(4) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> sorted_values: array<u32>;

// Consecutive pairs of a thread.
const EACH: u32 = 8u;

fn digit_of(key: u32) -> u32 {
    return (key >> digit.shift) & 15u;
}

var<workgroup> tally: array<atomic<u32>, 16>;

@compute @workgroup_size(256)
fn count(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = group_index(group, groups);
    if (lane < 16u) {
        atomicStore(&tally[lane], 0u);
    }
    workgroupBarrier();
    let first = (g * 256u + lane) * EACH;
    for (var i = first; i < min(first + EACH, digit.len); i++) {
        atomicAdd(&tally[digit_of(keys[i])], 1u);
    }
    workgroupBarrier();
    if (lane < 16u && g < digit.groups) {
        counts[lane * digit.groups + g] = atomicLoad(&tally[lane]);
    }
}

@compute @workgroup_size(256)
fn scan_counts(@builtin(local_invocation_index) lane: u32) {
    let len = 16u * digit.groups;
    let share = (len + 255u) / 256u;
    let begin = min(lane * share, len);
    let to = min(begin + share, len);
    var sum = 0u;
    for (var i = begin; i < to; i++) {
        sum += counts[i];
    }
    var next = scan(lane, sum) - sum;
    for (var i = begin; i < to; i++) {
        let here = counts[i];
        counts[i] = next;
        next += here;
    }
}

// Sixteen counters of 16 bits for each thread: two in a word.
var<workgroup> before: array<array<vec4<u32>, 2>, 256>;

@compute @workgroup_size(256)
fn scatter(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = group_index(group, groups);
    let first = (g * 256u + lane) * EACH;
    let end = min(first + EACH, digit.len);
    var own = array<vec4<u32>, 2>();
    for (var i = first; i < end; i++) {
        let d = digit_of(keys[i]);
        own[d / 8u][(d / 2u) % 4u] += 1u << (16u * (d % 2u));
    }
    var sum = own;
    before[lane] = own;
    workgroupBarrier();
    for (var step = 1u; step < 256u; step *= 2u) {
        if (lane >= step) {
            sum[0] += before[lane - step][0];
            sum[1] += before[lane - step][1];
        }
        workgroupBarrier();
        before[lane] = sum;
        workgroupBarrier();
    }
    // Those of earlier threads come first, and a thread's own in their order: equal digits keep theirs.
    var next = array<vec4<u32>, 2>(sum[0] - own[0], sum[1] - own[1]);
    for (var i = first; i < end; i++) {
        let key = keys[i];
        let d = digit_of(key);
        let half = 16u * (d % 2u);
        let rank = (next[d / 8u][(d / 2u) % 4u] >> half) & 0xffffu;
        next[d / 8u][(d / 2u) % 4u] += 1u << half;
        let place = counts[d * digit.groups + g] + rank;
        sorted_keys[place] = key;
        sorted_values[place] = values[i];
    }
}
