// Passes: a step of Adam on stored Gaussians: descend_params, descend_color (Kingma and Ba, 2015; no weight decay).

struct Descent {
    // Numbers in all, and of a Gaussian.
    len: u32,
    width: u32,
    // 1 / sqrt(1 - beta2^t).
    root: f32,
    // What regularizers add to the gradients of each opacity and of each scale.
    by_opacity: f32,
    by_scale: f32,
    // Rates over 1 - beta1^t of the columns: of twelve parameters; or of the first three numbers of a color, and of the others.
    rates: array<vec4<f32>, 3>,
}

@group(0) @binding(0) var<uniform> descent: Descent;
@group(0) @binding(1) var<storage, read> gradients: array<f32>;
// As they are stored: logarithms of scales, logits of opacities.
@group(0) @binding(2) var<storage, read_write> values: array<f32>;
@group(0) @binding(3) var<storage, read_write> first: array<f32>;
@group(0) @binding(4) var<storage, read_write> second: array<f32>;
// As they are drawn: mean 3, quaternion 4, scale 3, opacity 1, nothing.
@group(0) @binding(5) var<storage, read_write> params: array<f32>;

// What is kept of the moments, and what is taken of the gradient: 1 - 0.999 is not 0.001 in single precision.
const KEEP: vec2<f32> = vec2<f32>(0.9, 0.999);
const TAKE: vec2<f32> = vec2<f32>(0.1, 0.001);
const EPSILON: f32 = 1e-15;

fn descended(i: u32, gradient: f32, rate: f32) -> f32 {
    let m = KEEP.x * first[i] + TAKE.x * gradient;
    let v = KEEP.y * second[i] + TAKE.y * gradient * gradient;
    first[i] = m;
    second[i] = v;
    let value = values[i] - rate * m / (sqrt(v) * descent.root + EPSILON);
    values[i] = value;
    return value;
}

@compute @workgroup_size(256)
fn descend_params(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = group_index(group, groups) * 256u + lane;
    let column = i % descent.width;
    if (i >= descent.len || column == 11u) {
        return;
    }
    let rate = descent.rates[column / 4u][column % 4u];
    let drawn = params[i];
    let gradient = gradients[i];
    if (column < 7u) {
        params[i] = descended(i, gradient, rate);
    } else if (column < 10u) {
        params[i] = exp(descended(i, (gradient + descent.by_scale) * drawn, rate));
    } else {
        let logit = descended(i, (gradient + descent.by_opacity) * drawn * (1.0 - drawn), rate);
        params[i] = 1.0 / (1.0 + exp(-logit));
    }
}

@compute @workgroup_size(256)
fn descend_color(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = group_index(group, groups) * 256u + lane;
    if (i >= descent.len) {
        return;
    }
    let rate = select(descent.rates[0].y, descent.rates[0].x, i % descent.width < 3u);
    descended(i, gradients[i], rate);
}
