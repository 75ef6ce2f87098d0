// Passes: where the entries of each Gaussian begin, in the order of depth: count, scan, place. The sums of M, E and what was
// rejected are the only numbers that the host waits for.

struct Length {
    // Gaussians, and work groups that share them and one more place.
    len: u32,
    groups: u32,
}

@group(0) @binding(0) var<uniform> length: Length;
// Gaussians by depth.
@group(0) @binding(1) var<storage, read> ids: array<u32>;
@group(0) @binding(2) var<storage, read> tiles: array<u32>;
// Three sums per group: entries, Gaussians with entries, rejected ones.
@group(0) @binding(3) var<storage, read_write> sums: array<u32>;
// M, E, rejected.
@group(0) @binding(4) var<storage, read_write> totals: array<u32>;
// The first entry of the Gaussian at each place, and E behind the last; the place of each Gaussian.
@group(0) @binding(5) var<storage, read_write> first: array<u32>;
@group(0) @binding(6) var<storage, read_write> rank: array<u32>;

const REJECTED: u32 = 0xffffffffu;
// Consecutive Gaussians of a thread.
const EACH: u32 = 8u;

fn entries_at(place: u32) -> u32 {
    let count = tiles[ids[place]];
    return select(count, 0u, count == REJECTED);
}

@compute @workgroup_size(256)
fn sum_groups(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = group_index(group, groups);
    let begin = (g * 256u + lane) * EACH;
    var entries = 0u;
    var seen = 0u;
    var rejected = 0u;
    for (var place = begin; place < min(begin + EACH, length.len); place++) {
        let count = entries_at(place);
        entries = add(entries, count);
        seen += select(0u, 1u, count > 0u);
        rejected += select(0u, 1u, tiles[ids[place]] == REJECTED);
    }
    scan(lane, entries);
    let all_entries = total();
    workgroupBarrier();
    // At most 2048 in a group: both fit into a word.
    scan(lane, seen | rejected << 16u);
    if (lane == 0u && g < length.groups) {
        sums[3u * g] = all_entries;
        sums[3u * g + 1u] = total() & 0xffffu;
        sums[3u * g + 2u] = total() >> 16u;
    }
}

@compute @workgroup_size(256)
fn scan_groups(@builtin(local_invocation_index) lane: u32) {
    let share = (length.groups + 255u) / 256u;
    let begin = min(lane * share, length.groups);
    let to = min(begin + share, length.groups);
    var entries = 0u;
    var seen = 0u;
    var rejected = 0u;
    for (var g = begin; g < to; g++) {
        entries = add(entries, sums[3u * g]);
        seen += sums[3u * g + 1u];
        rejected += sums[3u * g + 2u];
    }
    let through = scan(lane, entries);
    let all_entries = total();
    workgroupBarrier();
    // Addition that stopped has lost what came before; such a drawing is refused.
    var next = through - min(entries, through);
    for (var g = begin; g < to; g++) {
        let here = sums[3u * g];
        sums[3u * g] = next;
        next = add(next, here);
    }
    scan(lane, seen);
    let all_seen = total();
    workgroupBarrier();
    scan(lane, rejected);
    if (lane == 0u) {
        totals[0] = all_seen;
        totals[1] = all_entries;
        totals[2] = total();
    }
}

@compute @workgroup_size(256)
fn place(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = group_index(group, groups);
    let begin = (g * 256u + lane) * EACH;
    var entries = 0u;
    for (var place = begin; place < min(begin + EACH, length.len); place++) {
        entries = add(entries, entries_at(place));
    }
    let through = scan(lane, entries);
    var next = 0u;
    if (g < length.groups) {
        next = add(sums[3u * g], through - min(entries, through));
    }
    for (var place = begin; place < min(begin + EACH, length.len + 1u); place++) {
        first[place] = next;
        if (place < length.len) {
            next = add(next, entries_at(place));
            rank[ids[place]] = place;
        }
    }
}
