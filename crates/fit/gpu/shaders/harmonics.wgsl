// Real spherical harmonics up to degree 4, with the signs and the order of the reference implementation of 3DGS.
//
// A number here is a vec4: its value, and its derivatives along x, y and z. One code gives the basis and its gradient.

const MOST_TERMS: u32 = 25u;

fn times(a: vec4<f32>, b: vec4<f32>) -> vec4<f32> {
    return vec4<f32>(a.x * b.x, a.x * b.yzw + b.x * a.yzw);
}

fn plus(a: vec4<f32>, b: f32) -> vec4<f32> {
    return vec4<f32>(a.x + b, a.yzw);
}

// The first `terms` basis functions at a unit direction.
fn basis_at(terms: u32, direction: vec3<f32>) -> array<vec4<f32>, MOST_TERMS> {
    var b: array<vec4<f32>, MOST_TERMS>;
    b[0] = vec4<f32>(0.2820947917738781, 0.0, 0.0, 0.0);
    if (terms < 4u) {
        return b;
    }
    let x = vec4<f32>(direction.x, 1.0, 0.0, 0.0);
    let y = vec4<f32>(direction.y, 0.0, 1.0, 0.0);
    let z = vec4<f32>(direction.z, 0.0, 0.0, 1.0);
    b[1] = -0.4886025119029199 * y;
    b[2] = 0.4886025119029199 * z;
    b[3] = -0.4886025119029199 * x;
    if (terms < 9u) {
        return b;
    }
    let xx = times(x, x);
    let yy = times(y, y);
    let zz = times(z, z);
    let xy = times(x, y);
    let yz = times(y, z);
    let xz = times(x, z);
    b[4] = 1.0925484305920792 * xy;
    b[5] = -1.0925484305920792 * yz;
    b[6] = 0.31539156525252005 * (zz + zz - xx - yy);
    b[7] = -1.0925484305920792 * xz;
    b[8] = 0.5462742152960396 * (xx - yy);
    if (terms < 16u) {
        return b;
    }
    let four = 4.0 * zz - xx - yy;
    b[9] = -0.5900435899266435 * times(y, 3.0 * xx - yy);
    b[10] = 2.890611442640554 * times(xy, z);
    b[11] = -0.4570457994644658 * times(y, four);
    b[12] = 0.3731763325901154 * times(z, 2.0 * zz - 3.0 * (xx + yy));
    b[13] = -0.4570457994644658 * times(x, four);
    b[14] = 1.445305721320277 * times(z, xx - yy);
    b[15] = -0.5900435899266435 * times(x, xx - 3.0 * yy);
    if (terms < 25u) {
        return b;
    }
    let seven = 7.0 * zz;
    b[16] = 2.5033429417967046 * times(xy, xx - yy);
    b[17] = -1.7701307697799304 * times(yz, 3.0 * xx - yy);
    b[18] = 0.9461746957575601 * times(xy, plus(seven, -1.0));
    b[19] = -0.6690465435572892 * times(yz, plus(seven, -3.0));
    b[20] = 0.10578554691520431 * plus(times(zz, plus(35.0 * zz, -30.0)), 3.0);
    b[21] = -0.6690465435572892 * times(xz, plus(seven, -3.0));
    b[22] = 0.47308734787878004 * times(xx - yy, plus(seven, -1.0));
    b[23] = -1.7701307697799304 * times(xz, xx - 3.0 * yy);
    b[24] = 0.6258357354491761 * (times(xx, xx - 3.0 * yy) - times(yy, 3.0 * xx - yy));
    return b;
}

// Coefficient k of Gaussian i.
fn coefficient(i: u32, k: u32) -> vec3<f32> {
    let at = i * view.color_len + 3u * k;
    return bitcast<vec3<f32>>(vec3<u32>(color[at], color[at + 1u], color[at + 2u]));
}
