//! Max pooling, which the networks of LPIPS use.

use weaver_autograd::{Backward, Buffer, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::parallel;

#[derive(Debug)]
struct MaxPool2d {
    size: usize,
    stride: usize,
    /// The place of each output's maximum in its plane.
    winners: Option<Buffer<u32>>,
}

impl MaxPool2d {
    fn out_len(&self, n: usize) -> usize {
        (n - self.size) / self.stride + 1
    }
}

impl<T: Real> Op<T> for MaxPool2d {
    fn name(&self) -> &'static str {
        "max_pool2d"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let size = self.size;
        let fits = |s: Shape| s.rank() == 4 && s[2] >= size && s[3] >= size;
        ensure_shape!(ins.len() == 1 && fits(ins[0]), "x [N, C, H, W] of at least {size} x {size}");
        let [n, c, h, w] = [ins[0][0], ins[0][1], ins[0][2], ins[0][3]];
        Ok(Shapes::one([n, c, self.out_len(h), self.out_len(w)]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], pool: &Pool) {
        let (width, pixels) = (ins[0].shape()[3], ins[0].shape()[2] * ins[0].shape()[3]);
        let out_width = outs[0].shape()[3];
        let plane = outs[0].shape()[2] * out_width;
        let (size, stride) = (self.size, self.stride);
        let mut winners = pool.buffer::<u32>(outs[0].len());
        parallel::for_chunks(&mut winners, plane, |p, winners| {
            let x = &ins[0][p * pixels..(p + 1) * pixels];
            for (i, winner) in winners.iter_mut().enumerate() {
                let corner = i / out_width * stride * width + i % out_width * stride;
                let mut best = corner;
                for at in (0..size).flat_map(|y| (0..size).map(move |x| corner + y * width + x)) {
                    // The first of equals wins; NaN wins over numbers, so that it is not hidden.
                    let is_nan = x[at].partial_cmp(&x[at]).is_none();
                    if x[at] > x[best] || is_nan {
                        best = at;
                    }
                }
                *winner = best as u32;
            }
        });
        parallel::for_chunks(&mut outs[0], plane, |p, y| {
            let x = &ins[0][p * pixels..(p + 1) * pixels];
            y.iter_mut().zip(&winners[p * plane..]).for_each(|(y, at)| *y = x[*at as usize]);
        });
        self.winners = Some(winners);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, outs, douts, dins, .. } = at;
        let Some(dx) = &mut dins[0] else { return };
        let winners = self.winners.as_ref().expect("the forward pass came first");
        let pixels = ins[0].shape()[2] * ins[0].shape()[3];
        let plane = outs[0].shape()[2] * outs[0].shape()[3];
        parallel::for_chunks(dx.accumulator(), pixels, |p, dx| {
            let range = p * plane..(p + 1) * plane;
            winners[range.clone()].iter().zip(&douts[0][range]).for_each(|(at, dy)| dx[*at as usize] += *dy);
        });
    }
}

/// The largest number of each `size` x `size` window of feature maps, windows `stride` apart, without padding.
///
/// x `[N, C, H, W]` gives `[N, C, floor((H - size) / stride) + 1, floor((W - size) / stride) + 1]`. Differentiable: the
/// gradient goes to the largest number of a window, the first one in reading order if several are equal. Panics when
/// the image is smaller than a window.
#[track_caller]
pub fn max_pool2d<T: Real>(x: Var<'_, T>, size: usize, stride: usize) -> Var<'_, T> {
    assert!(size > 0 && stride > 0, "max_pool2d: size and stride are at least 1");
    let [y] = x.tape().apply(MaxPool2d { size, stride, winners: None }, &[x]);
    y
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_autograd::Tape;

    #[test]
    fn the_first_of_equals_gets_the_gradient_and_nan_wins() {
        let tape = Tape::<f64>::new();
        let x = tape.leaf(&[1.0, 2.0, 2.0, 0.0, f64::NAN, 5.0], [1, 1, 2, 3]);
        let y = max_pool2d(x, 2, 1);
        assert!(y.value().iter().all(|y| y.is_nan()));
        let x = tape.leaf(&[1.0, 2.0, 2.0, 0.0, 2.0, 1.0], [1, 1, 2, 3]);
        let y = max_pool2d(x, 2, 1);
        assert_eq!(y.to_vec(), [2.0, 2.0]);
        y.sum().backward();
        assert_eq!(x.grad().unwrap(), [0.0, 2.0, 0.0, 0.0, 0.0, 0.0]);
    }
}
