//! Losses of surfaces: depth that is known, and normals that agree with depth.

use weaver_kernels::{Real, parallel};

/// Rows of pixels of a task.
const BAND: usize = 16;
/// Largest over least depth of a pixel and its neighbors from which on they show no surface, but the edge of one.
const JUMP: f64 = 1.05;
/// Alpha from which on a pixel shows a surface.
const OPAQUE: f64 = 0.5;

/// Cauchy's loss of the logarithm of drawn over known depth, with its gradient with respect to the drawn one:
///
/// `loss = 1 / P sum over pixels with known depth of s / 2 ln(1 + (r / s)^2)`, `r = ln(drawn / known)`,
///
/// where P is the number of all pixels: a photo of which little is known has little to say. A pixel whose depth is off
/// by more than `s`, such as one at the edge of something, counts less the farther it is off. Depth that is not a
/// positive number is not known, or not drawn. `gradient` is overwritten; it is of the unit of 1 / depth.
///
/// Source: Kerbl et al., A hierarchical 3D Gaussian representation, 2024, section 4 (depth as a loss, there of inverse
/// depth by its absolute value).
///
/// # Panics
/// If the lengths differ.
///
/// ```
/// let mut gradient = [0.0; 3];
/// let loss = weaver_losses::depth_loss(&[2.0_f64, 3.0, 5.0], &[2.0, 2.0, 0.0], 0.02, &mut gradient);
/// assert!(loss > 0.0 && gradient[0] == 0.0 && gradient[1] > 0.0 && gradient[2] == 0.0);
/// ```
pub fn depth_loss<T: Real>(drawn: &[T], known: &[T], s: f64, gradient: &mut [T]) -> f64 {
    assert!(drawn.len() == known.len() && drawn.len() == gradient.len(), "depth_loss: images of unequal sizes");
    let (s, over) = (T::from_f64(s), T::from_f64(1.0 / drawn.len().max(1) as f64));
    let mut sum = 0.0;
    for ((drawn, known), gradient) in drawn.iter().zip(known).zip(gradient) {
        let is_depth = |x: T| x > T::ZERO && x < T::INFINITY;
        *gradient = T::ZERO;
        if is_depth(*drawn) && is_depth(*known) {
            let r = (*drawn / *known).ln() / s;
            sum += (T::ONE + r * r).ln().to_f64();
            *gradient = over * r / ((T::ONE + r * r) * *drawn);
        }
    }
    0.5 * s.to_f64() * sum * over.to_f64()
}

/// A drawing whose normals are compared with its depth, `H` rows of `W` pixels.
#[derive(Clone, Copy, Debug)]
pub struct Relief<'a, T> {
    /// Expected depth along the optical axis, `[H, W]`.
    pub depth: &'a [T],
    /// `[H, W]`.
    pub alpha: &'a [T],
    /// Blended unit normals in the camera's axes, toward the camera, `sum of w n`, `[H, W, 3]`.
    pub normals: &'a [T],
    /// `[H, W]`
    pub size: [usize; 2],
    /// Focal lengths and principal point of the pinhole, pixels: fx, fy, cx, cy.
    pub intrinsics: [f64; 4],
}

/// Disagreement of blended normals with the surface that depth describes, and gradients with respect to depth and
/// normals:
///
/// `loss = 1 / P sum of (alpha - N . n)`, with `n` the unit normal of the places of the four neighbors of a pixel,
/// `(right - left) x (lower - upper)`, turned toward the camera.
///
/// Pixels count whose neighbors and themselves have an alpha of at least 1/2 and depths within 5 %; P is the number of
/// all pixels, and alpha is a constant. Gradients are overwritten.
///
/// Source: Huang et al., 2D Gaussian splatting for geometrically accurate radiance fields, 2024, equation 14.
///
/// # Panics
/// If the lengths differ.
///
/// ```
/// use weaver_losses::{Relief, normal_loss};
/// // A wall that faces the camera, and normals that say so.
/// let (depth, alpha, normals) = ([2.0_f64; 9], [1.0; 9], [0.0, 0.0, -1.0].repeat(9));
/// let relief = Relief {
///     depth: &depth,
///     alpha: &alpha,
///     normals: &normals,
///     size: [3, 3],
///     intrinsics: [4.0, 4.0, 1.5, 1.5],
/// };
/// let (mut of_depth, mut of_normals) = ([0.0; 9], [0.0; 27]);
/// assert!(normal_loss(&relief, &mut of_depth, &mut of_normals).abs() < 1e-12);
/// ```
pub fn normal_loss<T: Real>(relief: &Relief<'_, T>, of_depth: &mut [T], of_normals: &mut [T]) -> f64 {
    let Relief { depth, alpha, normals, size: [height, width], .. } = *relief;
    let pixels = height * width;
    let lengths = [depth.len(), alpha.len(), normals.len() / 3, of_depth.len(), of_normals.len() / 3];
    assert!(lengths == [pixels; 5], "normal_loss: images of unequal sizes");
    let over = T::from_f64(1.0 / pixels.max(1) as f64);
    // Derivatives by the differences of the places of neighbors, across and down.
    let mut differences = vec![[[T::ZERO; 3]; 2]; pixels];
    parallel::for_chunks2(
        &mut differences,
        BAND * width,
        of_normals,
        3 * BAND * width,
        |band, differences, of_normals| {
            for (i, (differences, of_normal)) in differences.iter_mut().zip(of_normals.chunks_exact_mut(3)).enumerate()
            {
                let at = band * BAND * width + i;
                of_normal.fill(T::ZERO);
                let Some(Tangents { across, down }) = relief.tangents(at) else { continue };
                let m = cross(across, down);
                let length = dot(m, m).sqrt();
                if length <= T::ZERO {
                    continue;
                }
                // Across and down turn away from the camera.
                let n = m.map(|x| -x / length);
                let normal = [0, 1, 2].map(|c| normals[3 * at + c]);
                let along = dot(n, normal);
                let of_m = [0, 1, 2].map(|c| over * (normal[c] - n[c] * along) / length);
                *differences = [cross(down, of_m), cross(of_m, across)];
                of_normal.iter_mut().zip(n).for_each(|(d, n)| *d = -over * n);
            }
        },
    );
    parallel::for_chunks(of_depth, BAND * width, |band, of_depth| {
        for (i, of_depth) in of_depth.iter_mut().enumerate() {
            let at = band * BAND * width + i;
            let (row, column) = (at / width, at % width);
            let mut of_place = [T::ZERO; 3];
            let mut add = |sign: T, d: [T; 3]| (0..3).for_each(|c| of_place[c] += sign * d[c]);
            // As the right neighbor of the pixel on the left, and so on.
            if column > 0 {
                add(T::ONE, differences[at - 1][0]);
            }
            if column + 1 < width {
                add(-T::ONE, differences[at + 1][0]);
            }
            if row > 0 {
                add(T::ONE, differences[at - width][1]);
            }
            if row + 1 < height {
                add(-T::ONE, differences[at + width][1]);
            }
            *of_depth = dot(of_place, relief.ray(at));
        }
    });
    // The gradient with respect to N is -n / P.
    let pixels = of_normals.chunks_exact(3).zip(normals.chunks_exact(3)).zip(alpha);
    let counted = pixels.filter(|((of_normal, _), _)| of_normal.iter().any(|d| *d != T::ZERO));
    let agreement = |((d, n), a): ((&[T], &[T]), &T)| over * *a + d[0] * n[0] + d[1] * n[1] + d[2] * n[2];
    counted.map(|pixel| agreement(pixel).to_f64()).sum()
}

/// Differences of the places of opposite neighbors of a pixel.
struct Tangents<T> {
    across: [T; 3],
    down: [T; 3],
}

impl<T: Real> Relief<'_, T> {
    /// The place that a pixel shows, over its depth.
    fn ray(&self, at: usize) -> [T; 3] {
        let [_, width] = self.size;
        let [fx, fy, cx, cy] = self.intrinsics;
        let (x, y) = ((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
        [T::from_f64((x - cx) / fx), T::from_f64((y - cy) / fy), T::ONE]
    }

    fn place(&self, at: usize) -> [T; 3] {
        self.ray(at).map(|x| x * self.depth[at])
    }

    /// None at the border, and where a neighbor shows no surface or another one.
    fn tangents(&self, at: usize) -> Option<Tangents<T>> {
        let [height, width] = self.size;
        let (row, column) = (at / width, at % width);
        if row == 0 || column == 0 || row + 1 == height || column + 1 == width {
            return None;
        }
        let near = [at, at - 1, at + 1, at - width, at + width];
        let least = T::from_f64(OPAQUE);
        if near.iter().any(|near| self.alpha[*near] < least) {
            return None;
        }
        let depths = near.map(|near| self.depth[near]);
        let (low, high) = depths.iter().fold((T::INFINITY, T::ZERO), |(low, high), z| (low.min(*z), high.max(*z)));
        if high > T::from_f64(JUMP) * low {
            return None;
        }
        let [_, left, right, upper, lower] = near.map(|near| self.place(near));
        Some(Tangents { across: minus(right, left), down: minus(lower, upper) })
    }
}

fn minus<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
