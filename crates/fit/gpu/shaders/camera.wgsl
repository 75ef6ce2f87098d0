// Pass: the camera's gradient from its parts, in order.

// How many parts there are.
@group(0) @binding(0) var<uniform> length: vec2<u32>;
// Twenty numbers per part.
@group(0) @binding(1) var<storage, read> parts: array<f32>;
@group(0) @binding(2) var<storage, read_write> sums: array<f32>;

@compute @workgroup_size(64)
fn sum_parts(@builtin(local_invocation_index) lane: u32) {
    if (lane >= 20u) {
        return;
    }
    var sum = 0.0;
    for (var part = 0u; part < length.x; part++) {
        sum += parts[20u * part + lane];
    }
    sums[lane] = sum;
}
