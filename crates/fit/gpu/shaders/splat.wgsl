// A splat: what a view knows of a Gaussian, sixteen numbers.

struct Splat {
    // mu, and p, q: u = p dx + q dy.
    center: vec2<f32>,
    pq: vec2<f32>,
    // v = r dy.
    r: f32,
    // o', the opacity, compensated when antialiased.
    opacity: f32,
    // Pixels that rounding may move the outline by.
    slack: f32,
    // Z.
    depth: f32,
    color: vec3<f32>,
    // Largest |dy| inside the outline, with slack.
    half_height: f32,
    // dy where the outline's dx is largest; dx is smallest at its negative.
    dy_of_right: f32,
    // u^2 + v^2 on the outline.
    reach: f32,
    // 1 / p and q / p.
    width: f32,
    tilt: f32,
}

// What a splat does to a pixel.
struct Sample {
    u: f32,
    v: f32,
    // o' 2^-(u^2 + v^2), before it is capped.
    raw: f32,
}

fn sample_at(center: vec2<f32>, pq: vec2<f32>, r: f32, opacity: f32, pixel: vec2<f32>) -> Sample {
    let d = pixel - center;
    let u = pq.x * d.x + pq.y * d.y;
    let v = r * d.y;
    return Sample(u, v, opacity * exp2(-(u * u + v * v)));
}

// The left top pixel of a tile, numbered in the region.
fn corner_of(tile: u32) -> vec2<u32> {
    return SIDE * vec2<u32>(view.grid.x + tile % view.grid.z, view.grid.y + tile / view.grid.z);
}

fn in_region(pixel: vec2<u32>) -> bool {
    return all(pixel >= view.region.xy) && all(pixel < view.region.xy + view.region.zw);
}

// Where the numbers of a pixel are in images of the region.
fn place_of(pixel: vec2<u32>) -> u32 {
    let at = pixel - view.region.xy;
    return at.y * view.region.z + at.x;
}
