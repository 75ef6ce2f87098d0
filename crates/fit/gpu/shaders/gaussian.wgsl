// Pass: from the sums over a splat's pixels to the gradients of its Gaussian, and the camera's in parts.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> params: array<u32>;
@group(0) @binding(2) var<storage, read> color: array<u32>;
@group(0) @binding(3) var<storage, read> first: array<u32>;
@group(0) @binding(4) var<storage, read> rank: array<u32>;
@group(0) @binding(5) var<storage, read> moments: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> dparams: array<f32>;
@group(0) @binding(7) var<storage, read_write> dcolor: array<f32>;
// Five rows per group.
@group(0) @binding(8) var<storage, read_write> camera: array<vec4<f32>>;

// Gradients of axes (9), shift (3), focal lengths (2), principal point (2), center (3): nineteen numbers.
alias Camera = array<vec4<f32>, 5>;

var<workgroup> parts: array<Camera, 128>;

struct GaussianGradient {
    mean: vec3<f32>,
    quat: vec4<f32>,
    scale: vec3<f32>,
    opacity: f32,
}

// Through the rotation matrix of q / |q|; the columns of d are those of the matrix.
fn dquat_of(unit: vec4<f32>, inverse_length: f32, d: mat3x3<f32>) -> vec4<f32> {
    let w = unit.x;
    let x = unit.y;
    let y = unit.z;
    let z = unit.w;
    let a = vec3<f32>(d[1].z - d[2].y, d[2].x - d[0].z, d[0].y - d[1].x);
    let b = vec3<f32>(d[1].x + d[0].y, d[2].x + d[0].z, d[2].y + d[1].z);
    let dunit = 2.0 * vec4<f32>(
        x * a.x + y * a.y + z * a.z,
        w * a.x + y * b.x + z * b.y - 2.0 * x * (d[1].y + d[2].z),
        w * a.y + x * b.x + z * b.z - 2.0 * y * (d[0].x + d[2].z),
        w * a.z + x * b.y + y * b.z - 2.0 * z * (d[0].x + d[1].y),
    );
    return (dunit - unit * dot(unit, dunit)) * inverse_length;
}

// Through the color: adds to the gradients of the coefficients of Gaussian i, and returns that of the line of sight.
fn color_backward(i: u32, mean: vec3<f32>, dtoward: vec3<f32>) -> vec3<f32> {
    let to = i * view.color_len;
    if (view.terms == 0u) {
        for (var channel = 0u; channel < view.color_len; channel++) {
            dcolor[to + channel] += sound(dtoward[channel]);
        }
        return vec3<f32>(0.0);
    }
    let sight = mean - view.center;
    let inverse_length = 1.0 / sqrt(dot(sight, sight));
    let unit = sight * inverse_length;
    let b = basis_at(view.terms, unit);
    var sum = vec3<f32>(0.5);
    for (var k = 0u; k < view.terms; k++) {
        sum += b[k].x * coefficient(i, k);
    }
    // Nothing passes where the color is clamped.
    let d = select(vec3<f32>(0.0), dtoward, sum > vec3<f32>(0.0));
    var dunit = vec3<f32>(0.0);
    for (var k = 0u; k < view.terms; k++) {
        dunit += dot(d, coefficient(i, k)) * b[k].yzw;
        let dh = sound3(b[k].x * d);
        dcolor[to + 3u * k] += dh.x;
        dcolor[to + 3u * k + 1u] += dh.y;
        dcolor[to + 3u * k + 2u] += dh.z;
    }
    if (view.terms == 1u) {
        return vec3<f32>(0.0);
    }
    return (dunit - unit * dot(unit, dunit)) * inverse_length;
}

// The columns of a b^T.
fn outer(a: vec3<f32>, b: vec3<f32>) -> mat3x3<f32> {
    return mat3x3<f32>(a * b.x, a * b.y, a * b.z);
}

fn gaussian_backward(i: u32, sums: array<vec4<f32>, 3>, camera_sums: ptr<function, Camera>) -> GaussianGradient {
    var out: GaussianGradient;
    let gaussian = gaussian_at(i);
    let s = projection_of(gaussian);
    let dsight = color_backward(i, gaussian.mean, vec3<f32>(sums[1].zw, sums[2].x));
    let p = s.factor.x;
    let q = s.factor.y;
    let r = s.factor.z;

    // g is o' times the gradient of the opacity o' = rho o.
    let dopacity = sums[0].x / (gaussian.opacity * s.compensation);
    out.opacity = sound(dopacity * s.compensation);

    // dM = L^T Gamma W: the rows of W = L M are never longer than 1, however long a needle is.
    let square = 1.0 / (BITS * BITS);
    let uu = sums[0].w * square;
    let uv = sums[1].x * square;
    let vv = sums[1].y * square;
    let turned1 = cross(s.m2, s.normal);
    let turned2 = cross(s.normal, s.m1);
    let w1 = p * r * r * (view.eps2d * s.m1 + turned1);
    let w2 = r * s.m2;
    let pulled1 = uu * w1 + uv * w2;
    let pulled2 = uv * w1 + vv * w2;
    var dm1 = p * pulled1;
    var dm2 = q * pulled1 + r * pulled2;
    if (s.compensated) {
        let inverse_det = 1.0 / s.det;
        let dratio = dopacity * gaussian.opacity / (2.0 * s.compensation);
        let ddet = -dratio * s.sharp * inverse_det * inverse_det;
        let dsharp = 2.0 * (dratio * inverse_det + ddet);
        let dsquares = 2.0 * ddet * view.eps2d;
        dm1 += dsharp * turned1 + dsquares * s.m1;
        dm2 += dsharp * turned2 + dsquares * s.m2;
    }

    // M = B R diag(s) with B = J A.
    let dmap1 = s.rotation * (gaussian.scale * dm1);
    let dmap2 = s.rotation * (gaussian.scale * dm2);
    let dproduct = outer(s.map1, dm1) + outer(s.map2, dm2);
    out.scale = sound3(vec3<f32>(
        dot(dproduct[0], s.rotation[0]),
        dot(dproduct[1], s.rotation[1]),
        dot(dproduct[2], s.rotation[2]),
    ));
    let drotation = mat3x3<f32>(
        dproduct[0] * gaussian.scale.x,
        dproduct[1] * gaussian.scale.y,
        dproduct[2] * gaussian.scale.z,
    );
    let dquat = dquat_of(s.unit, s.inverse_length, drotation);
    out.quat = vec4<f32>(sound(dquat.x), sound3(dquat.yzw));

    // The camera: row i of B is k_i (A_i - a_i A_3).
    let a1 = view.rows[0].xyz;
    let a2 = view.rows[1].xyz;
    let a3 = view.rows[2].xyz;
    let gu = sums[0].y / BITS;
    let gv = sums[0].z / BITS;
    let dcenter = vec2<f32>(p * gu, q * gu + r * gv);
    let diagonal = vec2<f32>(dot(dmap1, a1), dot(dmap2, a2));
    let tilt = vec2<f32>(dot(dmap1, a3), dot(dmap2, a3));
    let dzoom = diagonal - s.slope * tilt;
    let dbounded = -s.zoom * tilt;
    // Beyond the limits the slope is a function of the intrinsics.
    let dlimit = select(dbounded / view.focal, vec2<f32>(0.0), s.within);
    let dslope = dcenter * view.focal + select(vec2<f32>(0.0), dbounded, s.within);
    let dfocal = dzoom * s.inverse_z + dcenter * s.free - dlimit * s.slope;
    let dprincipal = dcenter - dlimit;
    let along = dzoom * s.zoom + dslope * s.free;
    let dpoint = vec3<f32>(dslope * s.inverse_z, sums[2].y - (along.x + along.y) * s.inverse_z);
    out.mean = sound3(dpoint.x * a1 + dpoint.y * a2 + dpoint.z * a3 + dsight);

    let axes1 = s.zoom.x * dmap1;
    let axes2 = s.zoom.y * dmap2;
    let d1 = sound3(axes1 + dpoint.x * gaussian.mean);
    let d2 = sound3(axes2 + dpoint.y * gaussian.mean);
    let d3 = sound3(dpoint.z * gaussian.mean - s.slope.x * axes1 - s.slope.y * axes2);
    let shift = sound3(dpoint);
    let focal = sound3(vec3<f32>(dfocal, dprincipal.x));
    let center = sound3(-dsight);
    *camera_sums = Camera(
        vec4<f32>(d1, d2.x),
        vec4<f32>(d2.yz, d3.xy),
        vec4<f32>(d3.z, shift),
        vec4<f32>(focal, sound(dprincipal.y)),
        vec4<f32>(center, 0.0),
    );
    return out;
}

@compute @workgroup_size(256)
fn differentiate(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = group_index(group, groups);
    let i = g * 256u + lane;
    var camera_sums = Camera();
    if (i < view.count) {
        let to = PARAMS * i;
        if (view.add == 0u) {
            for (var k = 0u; k < PARAMS; k++) {
                dparams[to + k] = 0.0;
            }
            for (var k = 0u; k < view.color_len; k++) {
                dcolor[i * view.color_len + k] = 0.0;
            }
        }
        let place = rank[view.first + i];
        let end = first[place + 1u];
        var sums = array<vec4<f32>, 3>();
        var entry = first[place];
        if (entry < end) {
            for (; entry < end; entry++) {
                sums[0] += moments[3u * entry];
                sums[1] += moments[3u * entry + 1u];
                sums[2] += moments[3u * entry + 2u];
            }
            let d = gaussian_backward(i, sums, &camera_sums);
            for (var k = 0u; k < 3u; k++) {
                dparams[to + k] += d.mean[k];
                dparams[to + 7u + k] += d.scale[k];
            }
            for (var k = 0u; k < 4u; k++) {
                dparams[to + 3u + k] += d.quat[k];
            }
            dparams[to + 10u] += d.opacity;
        }
    }
    // A tree over the threads: the upper half hands its sums to the lower one.
    for (var half = 128u; half > 0u; half /= 2u) {
        if (lane >= half && lane < 2u * half) {
            parts[lane - half] = camera_sums;
        }
        workgroupBarrier();
        if (lane < half) {
            for (var k = 0u; k < 5u; k++) {
                camera_sums[k] += parts[lane][k];
            }
        }
        workgroupBarrier();
    }
    let part = view.first / 256u + g;
    if (lane == 0u && i < view.count) {
        for (var k = 0u; k < 5u; k++) {
            camera[5u * part + k] = camera_sums[k];
        }
    }
}
