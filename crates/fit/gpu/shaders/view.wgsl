// One camera, the rules of drawing, and the part of the image that is drawn. docs/explain/rasterizer.md derives everything.

struct View {
    // [A t], row by row: a world point m is at A m + t in the camera.
    rows: array<vec4<f32>, 3>,
    // e = -A^-1 t.
    center: vec3<f32>,
    near: f32,
    // f1, f2 and c1, c2, pixels.
    focal: vec2<f32>,
    principal: vec2<f32>,
    // Limits of a1 and a2.
    low: vec2<f32>,
    high: vec2<f32>,
    background: vec3<f32>,
    far: f32,
    eps2d: f32,
    alpha_max: f32,
    radius_clip: f32,
    antialiased: u32,
    // The region that is drawn: x, y, width, height, pixels.
    region: vec4<u32>,
    // Its tiles: first column and row among those of the whole image, numbers of columns and rows.
    grid: vec4<u32>,
    // The Gaussians that are bound: the first, how many; and how many there are in all.
    first: u32,
    count: u32,
    total: u32,
    // Coefficients per Gaussian and channel, 0 for plain colors.
    terms: u32,
    // Numbers per color: 0, 3, or 3 times the coefficients.
    color_len: u32,
    // Whether gradients are added to those of the views before.
    add: u32,
    // Whether by-products of the backward pass are summed, and whether this band of the view is its first or last.
    statistics: u32,
    // Entries that there is room for.
    capacity: u32,
}

// Pixels per side of a tile.
const SIDE: u32 = 16u;
// A splat below this leaves a pixel alone.
const ALPHA_MIN: f32 = 1.0 / 255.0;
// A pixel ends before the splat that would bring its transmittance to this or less.
const TRANSMITTANCE_END: f32 = 1e-4;
// sqrt(log2(e) / 2): p, q and r are stored times it.
const BITS: f32 = 0.8493218;
