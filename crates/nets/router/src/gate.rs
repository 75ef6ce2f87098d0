//! Multiplies an expert's output by the router's choice of that expert.

use weaver_autograd::{Backward, Buffer, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};

#[derive(Debug)]
struct Gate {
    pixel: Buffer<u32>,
    expert: usize,
}

impl<T: Real> Op<T> for Gate {
    fn name(&self) -> &'static str {
        "gate"
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let n = self.pixel.len();
        ensure_shape!(ins[0].rank() == 2 && ins[0][0] == n && ins[0][1] > 0, "raw parameters [{n}, D] with D > 0");
        let last = self.pixel.iter().max().map_or(0, |&p| p as usize + 1);
        ensure_shape!(
            ins[1].rank() == 2 && ins[1][1] > self.expert && ins[1][0] >= last,
            "a choice [P, E] for expert {} of pixel {}",
            self.expert,
            last
        );
        Ok(Shapes::one(ins[0]))
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let (raw, choice) = (ins[0], ins[1]);
        let (width, experts) = (raw.shape().last(), choice.shape().last());
        let rows = outs[0].chunks_exact_mut(width).zip(raw.chunks_exact(width));
        for ((out, raw), &p) in rows.zip(self.pixel.iter()) {
            let c = choice[p as usize * experts + self.expert];
            out.iter_mut().zip(raw).for_each(|(out, raw)| *out = c * *raw);
        }
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        let (raw, choice, dout) = (ins[0], ins[1], douts[0]);
        let (width, experts) = (raw.shape().last(), choice.shape().last());
        let at = |p: u32| p as usize * experts + self.expert;
        if let Some(draw) = &mut dins[0] {
            draw.add_each(|i| choice[at(self.pixel[i / width])] * dout[i]);
        }
        if let Some(dchoice) = &mut dins[1] {
            let dchoice = dchoice.accumulator();
            let rows = raw.chunks_exact(width).zip(dout.chunks_exact(width));
            for ((raw, dout), &p) in rows.zip(self.pixel.iter()) {
                dchoice[at(p)] += raw.iter().zip(dout).map(|(raw, dout)| *raw * *dout).sum();
            }
        }
    }
}

/// Multiplies each row of an expert's output by the router's choice of that expert for the row's pixel.
///
/// Row i is multiplied by c[pixel i, expert], which is 1 where the router chose the expert: values do not change, and
/// the choice gets a gradient. `raw` `[n, D]` and `choice` `[P, E]` are differentiable, `pixel` `[n]` is constant; the
/// result is `[n, D]`. dL/dc is the sum over the row of raw times the gradient of the result. Panics on other shapes.
/// Source: official SplatWeaver code, `CardinalityGaussian`.
#[track_caller]
pub fn gate<'t, T: Real>(raw: Var<'t, T>, choice: Var<'t, T>, pixel: &[u32], expert: usize) -> Var<'t, T> {
    let op = Gate { pixel: raw.tape().pool().copy_of(pixel), expert };
    let [gated] = raw.tape().apply(op, &[raw, choice]);
    gated
}
