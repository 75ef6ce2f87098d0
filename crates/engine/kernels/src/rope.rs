//! Two-dimensional rotary position embedding (Su et al. 2021, arXiv 2104.09864), in the axial form of RoPE-ViT (Heo et
//! al. 2024, arXiv 2403.13298).

use crate::parallel::for_chunks;
use crate::target::{Target, put};
use crate::{Real, simd};

/// Approximate number of elements of one task, which takes whole tokens.
const GRAIN: usize = 1 << 13;

/// The rotations of a 2-D rotary position embedding for tokens at given positions.
///
/// The vector of a head, of length `dim`, has two halves: the first is rotated by the row of the token, the second by
/// its column. Within a half of length n, elements k and k + n/2 form a plane that is rotated by the angle `position *
/// base^(-2 k / n)`. A token at position (0, 0) is unchanged.
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
    /// Tabulates the rotations of tokens at `positions`, (row, column) each, for heads of length `dim`.
    ///
    /// # Panics
    ///
    /// If `dim` is not divisible by 4.
    pub fn new(positions: &[[usize; 2]], dim: usize, base: f64) -> Self {
        assert_eq!(dim % 4, 0, "rope2d: expected a head dimension divisible by 4, found {dim}");
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

    /// The inverse rotations.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let back = |[y_cos, y_sin, x_cos, x_sin]: &[T; 4]| [*y_cos, -*y_sin, *x_cos, -*x_sin];
        Self { dim: self.dim, angles: self.angles.iter().map(back).collect() }
    }

    /// Number of tokens.
    pub fn tokens(&self) -> usize {
        if self.dim == 0 { 0 } else { self.angles.len() / (self.dim / 4) }
    }

    /// Rotates the vector of every head: `x` and `y` are `[n, tokens, heads, dim]`, with the same positions for every
    /// n.
    ///
    /// # Panics
    ///
    /// If a length does not fit.
    #[inline(never)]
    pub fn forward(&self, heads: usize, x: &[T], y: &mut [T]) {
        self.turn(heads, x, (y, T::ZERO), T::ONE);
    }

    /// Gradient of [`Rope2d::forward`] with respect to its input: `dy` rotated back.
    ///
    /// # Panics
    ///
    /// If a length does not fit.
    #[inline(never)]
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
