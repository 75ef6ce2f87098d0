//! Resizing and box filtering of maps.

use crate::{Backward, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, resample};

/// The kind of resampling.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Method {
    Bilinear { align_corners: bool },
    Bicubic,
    BicubicAntialias,
    AveragePool { width: usize },
}

#[derive(Debug)]
struct Resample {
    method: Method,
    /// Height and width of the result; `None` keeps the input's.
    size: Option<[usize; 2]>,
}

impl Resample {
    /// The weights for maps of these sizes, computed once per pool.
    fn plan<T: Real>(&self, pool: &Pool, from: Shape, to: Shape) -> std::sync::Arc<resample::Resample<T>> {
        let (from, to) = ([from[2], from[3]], [to[2], to[3]]);
        pool.table((self.method, from, to), || match self.method {
            Method::Bilinear { align_corners } => resample::Resample::bilinear(from, to, align_corners),
            Method::Bicubic => resample::Resample::bicubic(from, to),
            Method::BicubicAntialias => resample::Resample::bicubic_antialiased(from, to),
            Method::AveragePool { width } => resample::Resample::box_filter(from, width),
        })
    }
}

impl<T: Real> Op<T> for Resample {
    fn name(&self) -> &'static str {
        match self.method {
            Method::Bilinear { .. } => "bilinear",
            Method::Bicubic => "bicubic",
            Method::BicubicAntialias => "bicubic_antialias",
            Method::AveragePool { .. } => "avg_pool_same",
        }
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(
            ins.len() == 1 && ins[0].rank() == 4 && ins[0][2] * ins[0][3] > 0,
            "x [N, C, H, W] with H, W > 0"
        );
        let [h, w] = self.size.unwrap_or([ins[0][2], ins[0][3]]);
        Ok(Shapes::one([ins[0][0], ins[0][1], h, w]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], pool: &Pool) {
        self.plan(pool, ins[0].shape(), outs[0].shape()).forward(&ins[0], &mut outs[0]);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, outs, douts, dins, pool } = at;
        if let Some(dx) = &mut dins[0] {
            self.plan(pool, ins[0].shape(), outs[0].shape()).backward(&douts[0], dx.target());
        }
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// Bilinear resizing.
    ///
    /// With `align_corners`, the centers of the corner pixels coincide, and row i is taken from the coordinate
    /// i (H - 1) / (h - 1). Otherwise the corners of the images coincide, and it is taken from (i + 1/2) H / h - 1/2,
    /// clamped to the image.
    ///
    /// x is `[N, C, H, W]`, with H and W at least 1; the result is `[N, C, h, w]`. Differentiable.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.constant(&[1.0, 3.0], [1, 1, 1, 2]).bilinear(1, 3, true).to_vec(), [1.0, 2.0, 3.0]);
    /// ```
    #[track_caller]
    pub fn bilinear(self, h: usize, w: usize, align_corners: bool) -> Self {
        self.resample(Method::Bilinear { align_corners }, Some([h, w]))
    }

    /// Bicubic resizing, without `align_corners` and without antialiasing.
    ///
    /// Uses Keys' kernel (1981) with a = -3/4 at the source coordinate (i + 1/2) H / h - 1/2, over the four nearest
    /// pixels even when shrinking; border pixels are repeated.
    ///
    /// x is `[N, C, H, W]`, with H and W at least 1; the result is `[N, C, h, w]`. Differentiable.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.constant(&[1.0, 3.0], [1, 1, 1, 2]).bicubic(1, 1).to_vec(), [2.0]);
    /// ```
    #[track_caller]
    pub fn bicubic(self, h: usize, w: usize) -> Self {
        self.resample(Method::Bicubic, Some([h, w]))
    }

    /// Antialiased bicubic resizing, without `align_corners`.
    ///
    /// Uses Keys' kernel (1981) with a = -1/2 at the source coordinate (i + 1/2) H / h - 1/2, stretched by the scale
    /// when shrinking; weights outside the image are dropped and the others scaled to sum to 1.
    ///
    /// x is `[N, C, H, W]`, with H and W at least 1; the result is `[N, C, h, w]`. Differentiable.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.constant(&[1.0, 3.0], [1, 1, 1, 2]).bicubic_antialias(1, 1).to_vec(), [2.0]);
    /// ```
    #[track_caller]
    pub fn bicubic_antialias(self, h: usize, w: usize) -> Self {
        self.resample(Method::BicubicAntialias, Some([h, w]))
    }

    /// Average pooling with stride 1: the mean over the part of the k x k window around every pixel that lies inside
    /// the image.
    ///
    /// x is `[N, C, H, W]`, with H and W at least 1, and so is the result. Differentiable. Panics if k is even.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.constant(&[1.0, 3.0, 8.0], [1, 1, 1, 3]).avg_pool_same(3).to_vec(), [2.0, 4.0, 5.5]);
    /// ```
    #[track_caller]
    pub fn avg_pool_same(self, k: usize) -> Self {
        assert!(k % 2 == 1, "avg_pool_same: a window of {k} has no center");
        self.resample(Method::AveragePool { width: k }, None)
    }

    #[track_caller]
    fn resample(self, method: Method, size: Option<[usize; 2]>) -> Self {
        let [y] = self.tape().apply(Resample { method, size }, &[self]);
        y
    }
}
