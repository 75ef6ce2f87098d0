//! Rotary embedding against complex multiplication.

use crate::{assert_close, noise, threads, widen};
use weaver_kernels::Real;
use weaver_kernels::rope::Rope2d;

const POSITIONS: [[usize; 2]; 5] = [[0, 0], [1, 1], [1, 2], [3, 1], [7, 12]];

fn agrees<T: Real>(n: usize, heads: usize, dim: usize, tolerance: f64) {
    let rope = Rope2d::<T>::new(&POSITIONS, dim, 100.0);
    assert_eq!(rope.tokens(), 5);
    let x = noise::<T>(n * 5 * heads * dim, 1);
    let mut y = vec![T::from_f64(f64::NAN); x.len()];
    rope.forward(heads, &x, &mut y);
    let mut expected = widen(&x);
    for (v, out) in expected.chunks_mut(dim).enumerate() {
        let token = v / heads % 5;
        let input = out.to_vec();
        let half = dim / 2;
        for axis in 0..2 {
            for k in 0..half / 2 {
                let angle = POSITIONS[token][axis] as f64 * 100f64.powf(-2.0 * k as f64 / half as f64);
                let (a, b) = (input[axis * half + k], input[axis * half + k + half / 2]);
                out[axis * half + k] = a * angle.cos() - b * angle.sin();
                out[axis * half + k + half / 2] = b * angle.cos() + a * angle.sin();
            }
        }
    }
    assert_close(&y, &expected, tolerance, "rope");
    // A rotation: the gradient of y pulled back is x again.
    let mut back = vec![T::ONE; x.len()];
    rope.backward(heads, &y, (&mut back, T::ONE));
    assert_close(&back, &x.iter().map(|x| x.to_f64() + 1.0).collect::<Vec<_>>(), tolerance, "backward");
    // Position (0, 0) is the identity.
    assert_eq!(y[..heads * dim], x[..heads * dim]);
}

#[test]
fn matches_the_definition() {
    for (n, heads, dim) in [(1, 1, 4), (2, 3, 32), (3, 2, 12)] {
        agrees::<f64>(n, heads, dim, 1e-13);
        agrees::<f32>(n, heads, dim, 1e-5);
    }
}

#[test]
fn same_bits_at_any_thread_count() {
    let rope = Rope2d::new(&POSITIONS, 32, 100.0);
    let x = noise::<f32>(200 * 5 * 32, 1);
    threads(|| {
        let mut y = vec![0.0; x.len()];
        rope.forward(1, &x, &mut y);
        y
    });
}
