//! Two-dimensional rotary position embedding (Su et al. 2021; the axial form of RoPE-ViT).

use crate::parallel::for_chunks;
use crate::target::{Target, put};
use crate::{Real, simd};

/// Tokens of one task: about this many elements.
const GRAIN: usize = 1 << 13;

/// Cosines and sines for tokens at given positions, made once.
///
/// A head's vector of length `dim` is two halves: the first is turned by the row, the second by the
/// column. Within a half of length n, elements k and k + n/2 are a plane turned by the angle
/// `position * base^(-2 k / n)`. Position (0, 0) leaves a token as it is.
///
/// ```
/// use weaver_kernels::rope::Rope2d;
/// let mut y = [0.0; 4];
/// Rope2d::new(&[[1, 0]], 4, 100.0).forward(1, &[1.0, 0.0, 1.0, 0.0], &mut y);
/// assert_eq!(y, [1_f64.cos(), 1_f64.sin(), 1.0, 0.0]);
/// ```
#[derive(Clone, Debug)]
pub struct Rope2d<T> {
    dim: usize,
    /// `[tokens, dim / 4]` pairs of planes: cosine and sine for the row, then for the column.
    angles: Vec<[T; 4]>,
}

impl<T: Real> Rope2d<T> {
    /// The table for tokens at `positions` (row, column); `dim` is divisible by 4.
    pub fn new(positions: &[[usize; 2]], dim: usize, base: f64) -> Self {
        assert_eq!(dim % 4, 0, "rope2d: the head dimension is two halves of planes");
        let half = dim as f64 / 2.0;
        let angles = positions.iter().flat_map(|position| {
            (0..dim / 4).map(move |k| {
                let frequency = base.powf(-2.0 * k as f64 / half);
                let [y, x] = position.map(|p| p as f64 * frequency);
                [y.cos(), y.sin(), x.cos(), x.sin()].map(T::from_f64)
            })
        });
        Self { dim, angles: angles.collect() }
    }

    /// Number of tokens.
    pub fn tokens(&self) -> usize {
        if self.dim == 0 { 0 } else { self.angles.len() / (self.dim / 4) }
    }

    /// y = x with every head's vector turned; both `[n, tokens, heads, dim]`, the same positions for
    /// every n.
    pub fn forward(&self, heads: usize, x: &[T], y: &mut [T]) {
        self.turn(heads, x, (y, T::ZERO), T::ONE);
    }

    /// Gradient: dy turned back.
    pub fn backward(&self, heads: usize, dy: &[T], dx: Target<T>) {
        self.turn(heads, dy, dx, -T::ONE);
    }

    fn turn(&self, heads: usize, x: &[T], y: Target<T>, sense: T) {
        let (y, beta) = y;
        let (dim, planes) = (self.dim, self.dim / 4);
        let token = heads * dim;
        assert_eq!(x.len(), y.len(), "rope2d: lengths");
        if y.is_empty() {
            return;
        }
        assert_eq!(
            x.len() % (self.tokens() * token),
            0,
            "rope2d: length for {} tokens of {heads} heads",
            self.tokens()
        );
        let grain = GRAIN.div_ceil(token);
        for_chunks(y, grain * token, |chunk, y| {
            let x = &x[chunk * grain * token..][..y.len()];
            simd::dispatch(
                #[inline(always)]
                || {
                    for (t, (x, y)) in x.chunks_exact(token).zip(y.chunks_exact_mut(token)).enumerate() {
                        let t = (chunk * grain + t) % self.tokens();
                        let angles = &self.angles[t * planes..][..planes];
                        for (x, y) in x.chunks_exact(dim).zip(y.chunks_exact_mut(dim)) {
                            for (k, [y_cos, y_sin, x_cos, x_sin]) in angles.iter().enumerate() {
                                for (at, cos, sin) in [(k, *y_cos, *y_sin), (2 * planes + k, *x_cos, *x_sin)] {
                                    let (a, b, sin) = (x[at], x[at + planes], sense * sin);
                                    put(&mut y[at], beta, a * cos - b * sin);
                                    put(&mut y[at + planes], beta, b * cos + a * sin);
                                }
                            }
                        }
                    }
                },
            );
        });
    }
}
