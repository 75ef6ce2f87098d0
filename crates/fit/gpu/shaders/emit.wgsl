// Pass: the entries of each Gaussian, in the order of depth: (tile, entry), and whose it is.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<vec4<f32>>;
// Gaussians by depth, and where the entries of each begin.
@group(0) @binding(2) var<storage, read> ids: array<u32>;
@group(0) @binding(3) var<storage, read> first: array<u32>;
@group(0) @binding(4) var<storage, read_write> tile_of: array<u32>;
@group(0) @binding(5) var<storage, read_write> entries: array<u32>;
@group(0) @binding(6) var<storage, read_write> owners: array<u32>;

fn splat_at(n: u32) -> Splat {
    let a = splats[4u * n];
    let b = splats[4u * n + 1u];
    let c = splats[4u * n + 2u];
    let d = splats[4u * n + 3u];
    return Splat(a.xy, a.zw, b.x, b.y, b.z, b.w, c.xyz, c.w, d.x, d.y, d.z, d.w);
}

fn put(entry: u32, tile: u32, owner: u32) {
    tile_of[entry] = tile;
    entries[entry] = entry;
    owners[entry] = owner;
}

@compute @workgroup_size(256)
fn emit(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let place = group_index(group, groups) * 256u + lane;
    // Room that is left over belongs to the tile behind the last.
    let threads = groups.x * groups.y * 256u;
    for (var unused = first[view.total] + place; unused < view.capacity; unused += threads) {
        put(unused, view.grid.z * view.grid.w, 0u);
    }
    if (place >= view.total) {
        return;
    }
    var entry = first[place];
    // The farthest Gaussians find no room first.
    let end = min(first[place + 1u], view.capacity);
    if (entry >= end) {
        return;
    }
    let n = ids[place];
    let splat = splat_at(n);
    let rows = rows_of(splat);
    for (var row = rows.x; row < rows.y; row++) {
        let columns = columns_of(splat, row);
        let before = (row - view.grid.y) * view.grid.z - view.grid.x;
        for (var column = columns.x; column < columns.y && entry < end; column++) {
            put(entry, before + column, n);
            entry++;
        }
    }
    // Compilers may round here otherwise than where entries were counted: what was counted in vain goes to a tile behind the last.
    for (; entry < end; entry++) {
        put(entry, view.grid.z * view.grid.w, n);
    }
}
