//! Layouts of the reference beside those of this crate.

/// [V, C, H W] to [V H W, C].
pub fn to_rows(x: &[f32], views: usize, channels: usize) -> Vec<f32> {
    transpose_each(x, views, channels)
}

/// [n, a, b] to [n, b, a].
pub fn transpose_each(x: &[f32], n: usize, a: usize) -> Vec<f32> {
    let b = x.len() / (n * a);
    let mut out = vec![0.0; x.len()];
    for i in 0..n {
        for r in 0..a {
            for c in 0..b {
                out[(i * b + c) * a + r] = x[(i * a + r) * b + c];
            }
        }
    }
    out
}

/// Quaternions xyzw to wxyz.
pub fn w_first(x: &[f32]) -> Vec<f32> {
    x.chunks_exact(4).flat_map(|q| [q[3], q[0], q[1], q[2]]).collect()
}
