//! Agreement of views about depths: features of a pixel against those where other views see it, for several depths.

use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{parallel, simd};

/// Smallest depth in another view at which a point is seen, as a fraction of the depth in its own.
const NEAREST: f64 = 1e-3;

#[derive(Debug)]
struct PlaneSweep {
    factors: Vec<f64>,
    pixel_offset: f64,
}

/// From a pixel of one view and its depth to the pixel of another: q = depth M (x, y, 1) + b, and then q / q_z.
struct Pair {
    matrix: [[f64; 3]; 3],
    shift: [f64; 3],
}

/// Sampling position of a view: four rows of its features and their weights.
#[derive(Clone, Copy)]
struct Sample<T> {
    rows: [usize; 4],
    weights: [T; 4],
}

/// Sizes of the maps.
#[derive(Clone, Copy)]
struct Size {
    views: usize,
    height: usize,
    width: usize,
    channels: usize,
}

impl PlaneSweep {
    fn size(ins: &[View<'_, impl Real>]) -> Size {
        let s = ins[0].shape();
        Size { views: s[0], height: s[1], width: s[2], channels: s[3] }
    }

    fn pair<T: Real>(ins: &[View<'_, T>], from: usize, to: usize) -> Pair {
        let pose = |v: usize, i: usize| ins[2][12 * v + i].to_f64();
        let k = |v: usize, i: usize| ins[3][4 * v + i].to_f64();
        // R = R_to R_from^T, t = t_to - R t_from
        let turn = |i: usize, j: usize| (0..3).map(|a| pose(to, 4 * i + a) * pose(from, 4 * j + a)).sum::<f64>();
        let rotation: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| turn(i, j)));
        let translation: [f64; 3] = std::array::from_fn(|i| {
            pose(to, 4 * i + 3) - (0..3).map(|j| rotation[i][j] * pose(from, 4 * j + 3)).sum::<f64>()
        });
        let ray = |row: [f64; 3]| {
            let (x, y) = (row[0] / k(from, 0), row[1] / k(from, 1));
            [x, y, row[2] - x * k(from, 2) - y * k(from, 3)]
        };
        let rays = rotation.map(ray);
        let project = |i: usize, z: f64, own: f64| if i < 2 { k(to, i) * own + k(to, 2 + i) * z } else { z };
        Pair {
            matrix: std::array::from_fn(|i| std::array::from_fn(|j| project(i, rays[2][j], rays[i][j]))),
            shift: std::array::from_fn(|i| project(i, translation[2], translation[i])),
        }
    }

    /// Calls `visit` with the pixel, the number of the depth and the samples of the other views for each depth of each
    /// pixel of an image row.
    #[inline(always)]
    fn for_row<T: Real>(
        &self,
        ins: &[View<'_, T>],
        image_row: usize,
        mut visit: impl FnMut(usize, usize, &[Sample<T>]),
    ) {
        let Size { views, height, width, .. } = Self::size(ins);
        let (view, row) = (image_row / height, image_row % height);
        let others = (0..views).filter(|&u| u != view);
        let pairs: Vec<(usize, Pair)> = others.map(|u| (u, Self::pair(ins, view, u))).collect();
        let mut lines = vec![[0.0; 3]; pairs.len()];
        let mut samples = Vec::with_capacity(views);
        for column in 0..width {
            let pixel = image_row * width + column;
            let depth = ins[1][pixel].to_f64();
            let at = [column as f64 + self.pixel_offset, row as f64 + self.pixel_offset, 1.0];
            for (line, (_, pair)) in lines.iter_mut().zip(&pairs) {
                *line = pair.matrix.map(|m| depth * (m[0] * at[0] + m[1] * at[1] + m[2] * at[2]));
            }
            for (number, factor) in self.factors.iter().enumerate() {
                samples.clear();
                for (line, (u, pair)) in lines.iter().zip(&pairs) {
                    let q: [f64; 3] = std::array::from_fn(|i| factor * line[i] + pair.shift[i]);
                    let (x, y) = (q[0] / q[2], q[1] / q[2]);
                    let seen =
                        q[2] > NEAREST * depth && (0.0..width as f64).contains(&x) && (0.0..height as f64).contains(&y);
                    if seen {
                        samples.push(self.sample(*u, x, y, [height, width]));
                    }
                }
                visit(pixel, number, &samples);
            }
        }
    }

    /// Bilinear interpolation between the centers of pixels, and of the outermost ones beyond.
    fn sample<T: Real>(&self, view: usize, x: f64, y: f64, [height, width]: [usize; 2]) -> Sample<T> {
        let split = |x: f64, length: usize| {
            let x = (x - self.pixel_offset).clamp(0.0, (length - 1) as f64);
            let low = (x as usize).min(length.saturating_sub(2));
            (low, (low + 1).min(length - 1), x - low as f64)
        };
        let ((left, right, fx), (top, bottom, fy)) = (split(x, width), split(y, height));
        let row = |r: usize, c: usize| (view * height + r) * width + c;
        Sample {
            rows: [row(top, left), row(top, right), row(bottom, left), row(bottom, right)],
            weights: [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy].map(T::from_f64),
        }
    }
}

/// Channels that are summed at a time, in registers.
const BLOCK: usize = 8;

/// Sums the features `[P, C]` of all samples.
#[inline(always)]
fn gather<T: Real>(samples: &[Sample<T>], features: &[T], sum: &mut [T]) {
    let channels = sum.len();
    for (block, sum) in sum.chunks_mut(BLOCK).enumerate() {
        let mut all = [T::ZERO; BLOCK];
        for sample in samples {
            for (row, weight) in sample.rows.into_iter().zip(sample.weights) {
                let x = &features[row * channels + block * BLOCK..][..sum.len()];
                match x.first_chunk::<BLOCK>() {
                    Some(x) => all.iter_mut().zip(x).for_each(|(all, x)| *all += weight * *x),
                    None => all.iter_mut().zip(x).for_each(|(all, x)| *all += weight * *x),
                }
            }
        }
        sum.copy_from_slice(&all[..sum.len()]);
    }
}

/// y += a x, in blocks that the compiler turns into vectors however short the rows are.
#[inline(always)]
fn add_scaled<T: Real>(y: &mut [T], a: T, x: &[T]) {
    let ((y, y_rest), (x, x_rest)) = (y.as_chunks_mut::<BLOCK>(), x.as_chunks::<BLOCK>());
    for (y, x) in y.iter_mut().zip(x) {
        for (y, x) in y.iter_mut().zip(x) {
            *y += a * *x;
        }
    }
    y_rest.iter_mut().zip(x_rest).for_each(|(y, x)| *y += a * *x);
}

/// The factor of a sum over so many samples.
fn share<T: Real>(samples: usize, channels: usize) -> T {
    T::from_f64(1.0 / (samples as f64 * (channels as f64).sqrt()))
}

impl<T: Real> Op<T> for PlaneSweep {
    fn name(&self) -> &'static str {
        "plane_sweep"
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins[0].rank() == 4 && !ins[0].is_empty(), "features [V, H, W, C]");
        let [views, height, width] = [ins[0][0], ins[0][1], ins[0][2]];
        ensure_shape!(ins[1] == Shape::from([views, height, width]), "depth [{views}, {height}, {width}]");
        ensure_shape!(
            ins[2] == Shape::from([views, 3, 4]) && ins[3] == Shape::from([views, 4]),
            "viewmats [{views}, 3, 4] and intrinsics [{views}, 4]"
        );
        Ok(Shapes::one([views, height, width, self.factors.len()]))
    }

    fn differentiable(&self, index: usize) -> bool {
        index == 0
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let Size { width, channels, .. } = Self::size(ins);
        let depths = self.factors.len();
        let features: &[T] = &ins[0];
        let this = &*self;
        parallel::for_chunks(&mut outs[0], width * depths, |image_row, out| {
            simd::dispatch(
                #[inline(always)]
                || {
                    let mut seen = vec![T::ZERO; channels];
                    this.for_row(ins, image_row, |pixel, number, samples| {
                        let at = (pixel - image_row * width) * depths + number;
                        if samples.is_empty() {
                            out[at] = T::ZERO;
                            return;
                        }
                        gather(samples, features, &mut seen);
                        let own = &features[pixel * channels..][..channels];
                        let product: T = own.iter().zip(&seen).map(|(a, b)| *a * *b).sum();
                        out[at] = product * share(samples.len(), channels);
                    });
                },
            );
        });
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, pool, .. } = at;
        let Some(dfeatures) = &mut dins[0] else { return };
        let Size { views, height, channels, .. } = Self::size(ins);
        let (depths, all) = (self.factors.len(), ins[0].len());
        let (features, dagreement): (&[T], &[T]) = (&ins[0], &douts[0]);
        // The slopes from each view's pixels, apart, so that views can be walked at once and added up in order.
        let mut pulls = pool.filled(views * all, T::ZERO);
        parallel::for_chunks(&mut pulls, all, |view, pull| {
            simd::dispatch(
                #[inline(always)]
                || {
                    let mut seen = vec![T::ZERO; channels];
                    for image_row in view * height..(view + 1) * height {
                        self.for_row(ins, image_row, |pixel, number, samples| {
                            if samples.is_empty() {
                                return;
                            }
                            let d = dagreement[pixel * depths + number] * share(samples.len(), channels);
                            gather(samples, features, &mut seen);
                            add_scaled(&mut pull[pixel * channels..][..channels], d, &seen);
                            let own = &features[pixel * channels..][..channels];
                            let taps = samples.iter().flat_map(|sample| sample.rows.into_iter().zip(sample.weights));
                            for (row, weight) in taps {
                                add_scaled(&mut pull[row * channels..][..channels], d * weight, own);
                            }
                        });
                    }
                },
            );
        });
        let dfeatures = dfeatures.accumulator();
        for pull in pulls.chunks_exact(all) {
            dfeatures.iter_mut().zip(pull).for_each(|(d, pull)| *d += *pull);
        }
    }
}

/// Agreement of the other views with each pixel's features at multiples of its depth.
///
/// For pixel p of view v at depth `factors[k]` times its own: the mean over all other views that see this point of the
/// scalar product of the features of p with theirs where they see it, bilinearly interpolated, over the square root of
/// C; 0 where none does.
///
/// `features` `[V, H, W, C]` are differentiable; `depth` `[V, H, W]`, `viewmats` `[V, 3, 4]` and `intrinsics` `[V, 4]`
/// in pixels are held constant. The result is `[V, H, W, K]`. `pixel_offset` is where in a pixel its ray passes, 0.5
/// for the center. Panics on other shapes. Source: Collins, CVPR 1996; Yao et al., MVSNet, ECCV 2018, section 3.2, with
/// a scalar product.
///
/// ```
/// use weaver_autograd::Tape;
/// use weaver_pose::plane_sweep;
/// // Two views side by side of a wall at depth 2 with one bright column.
/// let tape = Tape::<f64>::new();
/// let features = tape.leaf(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0], [2, 1, 4, 1]);
/// let depth = tape.constant(&[1.0; 8], [2, 1, 4]);
/// let mut poses = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0].repeat(2);
/// poses[15] = -1.0;
/// let cameras = (tape.constant(&poses, [2, 3, 4]), tape.constant(&[2.0, 2.0, 2.0, 0.5].repeat(2), [2, 4]));
/// let agreement = plane_sweep(features, depth, cameras.0, cameras.1, &[1.0, 2.0, 4.0], 0.5).to_vec();
/// assert_eq!(agreement[6..9], [0.0, 1.0, 0.5]); // twice the depth is right, four times half a pixel off
/// ```
#[track_caller]
pub fn plane_sweep<'t, T: Real>(
    features: Var<'t, T>,
    depth: Var<'t, T>,
    viewmats: Var<'t, T>,
    intrinsics: Var<'t, T>,
    factors: &[f64],
    pixel_offset: f64,
) -> Var<'t, T> {
    let op = PlaneSweep { factors: factors.to_vec(), pixel_offset };
    let constants = [depth, viewmats, intrinsics].map(Var::detach);
    let [agreement] = features.tape().apply(op, &[features, constants[0], constants[1], constants[2]]);
    agreement
}
