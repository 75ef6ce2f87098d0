// Which tiles a splat may be seen in: its outline, the ellipse where alpha reaches 1/255, row by row.

// The columns (axis 0) or rows (axis 1) of tiles with a pixel center in [low, high]: the first, and the one behind the last.
fn touched(axis: u32, low: f32, high: f32) -> vec2<u32> {
    let side = f32(SIDE);
    let first = view.grid[axis];
    let end = first + view.grid[axis + 2u];
    let most = f32(end);
    let begin = clamp(ceil((low - side + 0.5) / side), 0.0, most);
    let to = clamp(floor((high - 0.5) / side + 1.0), 0.0, most);
    return vec2<u32>(max(u32(begin), first), min(u32(to), end));
}

fn rows_of(splat: Splat) -> vec2<u32> {
    return touched(1u, splat.center.y - splat.half_height, splat.center.y + splat.half_height);
}

// Half of the outline's width at dy.
fn half_width(splat: Splat, dy: f32) -> f32 {
    let v = splat.r * dy;
    return sqrt(max(splat.reach - v * v, 0.0)) * splat.width;
}

// The columns that the outline touches in a row of tiles. It is convex: widest where it is widest, or at the row's nearer edge.
fn columns_of(splat: Splat, row: u32) -> vec2<u32> {
    let top = f32(row * SIDE) + 0.5;
    let low = max(top - splat.center.y - splat.slack, -splat.half_height);
    let high = min(top + f32(SIDE) - 1.0 - splat.center.y + splat.slack, splat.half_height);
    if (high < low) {
        return vec2<u32>(0u, 0u);
    }
    let at_right = min(max(splat.dy_of_right, low), high);
    let at_left = min(max(-splat.dy_of_right, low), high);
    let right = splat.center.x + splat.slack + (half_width(splat, at_right) - splat.tilt * at_right);
    let left = splat.center.x - splat.slack - (half_width(splat, at_left) + splat.tilt * at_left);
    return touched(0u, left, right);
}
