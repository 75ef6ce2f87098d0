// Pass: where the list of each tile starts among the sorted entries; of the tile behind the last, too, and where that ends.

@group(0) @binding(0) var<uniform> lists: vec2<u32>;
@group(0) @binding(1) var<storage, read> tile_of: array<u32>;
@group(0) @binding(2) var<storage, read_write> starts: array<u32>;

@compute @workgroup_size(256)
fn start(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let entries = lists.x;
    let tiles = lists.y;
    let i = group_index(group, groups) * 256u + lane;
    if (i > entries) {
        return;
    }
    // Tiles from that of the entry before to that of this one begin here, those without entries included.
    var begin = 0u;
    if (i > 0u) {
        begin = tile_of[i - 1u] + 1u;
    }
    var to = tiles + 1u;
    if (i < entries) {
        to = tile_of[i];
    }
    for (var tile = begin; tile <= to; tile++) {
        starts[tile] = i;
    }
}
