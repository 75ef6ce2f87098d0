// From a Gaussian to the shape of its shadow. Nothing cancels: det S is a sum of positive terms.

struct Gaussian {
    mean: vec3<f32>,
    // w, x, y, z.
    quat: vec4<f32>,
    scale: vec3<f32>,
    opacity: f32,
    // Whether all of these are finite, and the quaternion is not zero.
    sound: bool,
}

// Everything between a Gaussian and its splat; backward computes it anew.
struct Projection {
    // (X, Y, Z).
    point: vec3<f32>,
    // X/Z and Y/Z, and the same within their limits: a1, a2.
    free: vec2<f32>,
    slope: vec2<f32>,
    within: vec2<bool>,
    // k1, k2.
    zoom: vec2<f32>,
    inverse_z: f32,
    // B = J A, row by row.
    map1: vec3<f32>,
    map2: vec3<f32>,
    // The unit quaternion, and 1 / |q|.
    unit: vec4<f32>,
    inverse_length: f32,
    // R; WGSL keeps columns.
    rotation: mat3x3<f32>,
    // M = J A R diag(s), row by row, and m1 x m2.
    m1: vec3<f32>,
    m2: vec3<f32>,
    normal: vec3<f32>,
    // S11 and S22.
    variance: vec2<f32>,
    // det M M^T and det S.
    sharp: f32,
    det: f32,
    // rho, and whether it depends on the shape.
    compensation: f32,
    compensated: bool,
    // p, q, r of sigma = (u^2 + v^2) / 2.
    factor: vec3<f32>,
}

// Smallest ratio of determinants; no gradient flows through it where it holds.
const RATIO_FLOOR: f32 = 0.005 * 0.005;

// Twelve numbers per Gaussian: mean, quaternion, scale, opacity, nothing.
const PARAMS: u32 = 12u;

fn gaussian_at(i: u32) -> Gaussian {
    var x: array<f32, 11>;
    var all_finite = true;
    for (var k = 0u; k < 11u; k++) {
        let bits = params[PARAMS * i + k];
        all_finite = all_finite && (bits & 0x7f800000u) != 0x7f800000u;
        x[k] = bitcast<f32>(bits);
    }
    let quat = vec4<f32>(x[3], x[4], x[5], x[6]);
    let some = any(quat != vec4<f32>(0.0));
    let scale = vec3<f32>(x[7], x[8], x[9]);
    return Gaussian(vec3<f32>(x[0], x[1], x[2]), quat, scale, x[10], all_finite && some);
}

// R of a unit quaternion.
fn rotation_of(unit: vec4<f32>) -> mat3x3<f32> {
    let w = unit.x;
    let x = unit.y;
    let y = unit.z;
    let z = unit.w;
    return mat3x3<f32>(
        vec3<f32>(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        vec3<f32>(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        vec3<f32>(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    );
}

fn projection_of(gaussian: Gaussian) -> Projection {
    var s: Projection;
    let a1 = view.rows[0].xyz;
    let a2 = view.rows[1].xyz;
    let a3 = view.rows[2].xyz;
    let shift = vec3<f32>(view.rows[0].w, view.rows[1].w, view.rows[2].w);
    s.point = vec3<f32>(dot(a1, gaussian.mean), dot(a2, gaussian.mean), dot(a3, gaussian.mean)) + shift;
    s.inverse_z = 1.0 / s.point.z;
    s.free = s.point.xy * s.inverse_z;
    s.within = (s.free >= view.low) & (s.free <= view.high);
    s.slope = min(max(s.free, view.low), view.high);
    s.zoom = view.focal * s.inverse_z;
    s.map1 = s.zoom.x * (a1 - s.slope.x * a3);
    s.map2 = s.zoom.y * (a2 - s.slope.y * a3);

    // Scaled first, so that no length overflows.
    let size = abs(gaussian.quat);
    let largest = max(max(size.x, size.y), max(size.z, size.w));
    let scaled = gaussian.quat / largest;
    let inverse = 1.0 / sqrt(dot(scaled, scaled));
    s.unit = scaled * inverse;
    s.inverse_length = inverse / largest;
    s.rotation = rotation_of(s.unit);

    s.m1 = (s.map1 * s.rotation) * gaussian.scale;
    s.m2 = (s.map2 * s.rotation) * gaussian.scale;
    s.normal = cross(s.m1, s.m2);
    let squares = vec2<f32>(dot(s.m1, s.m1), dot(s.m2, s.m2));
    s.variance = squares + view.eps2d;
    s.sharp = dot(s.normal, s.normal);
    s.det = s.sharp + view.eps2d * (squares.x + squares.y) + view.eps2d * view.eps2d;
    let deviation = sqrt(s.variance.y);
    let inverse_root = 1.0 / sqrt(s.det);
    let inverse_deviation = 1.0 / deviation;
    s.factor = vec3<f32>(
        deviation * inverse_root,
        -dot(s.m1, s.m2) * inverse_deviation * inverse_root,
        inverse_deviation,
    );
    let ratio = s.sharp / s.det;
    s.compensated = view.antialiased != 0u && ratio > RATIO_FLOOR;
    s.compensation = select(1.0, sqrt(max(ratio, RATIO_FLOOR)), view.antialiased != 0u);
    return s;
}
