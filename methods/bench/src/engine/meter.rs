//! Timing of a piece of work.

use crate::median;
use std::time::{Duration, Instant};
use weaver_autograd::{List, Params, Tape, Var};
use weaver_kernels::random::Stream;

/// Shortest duration of one timing; shorter work is repeated until it takes this long.
const LEAST: Duration = Duration::from_millis(60);

/// The amount of work in a row of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Work {
    /// Additions and multiplications.
    Operations(f64),
    /// Bytes that have to be read or written.
    Bytes(f64),
}

/// Times pieces of work.
#[derive(Debug)]
pub struct Meter {
    runs: usize,
}

impl Meter {
    /// Medians over `runs` timings.
    pub fn new(runs: usize) -> Self {
        Self { runs }
    }

    /// Milliseconds of `job`, after a few untimed runs.
    pub fn ms(&self, mut job: impl FnMut()) -> f64 {
        job();
        job();
        let start = Instant::now();
        job();
        let once = start.elapsed().max(Duration::from_nanos(100));
        let repetitions = (LEAST.as_secs_f64() / once.as_secs_f64()).max(1.0) as u32;
        median((0..self.runs).map(|_| {
            let start = Instant::now();
            for _ in 0..repetitions {
                job();
            }
            start.elapsed().as_secs_f64() * 1e3 / f64::from(repetitions)
        }))
    }

    /// Milliseconds of the forward pass of `of` on a tape, from inputs of these shapes, without gradients.
    pub fn forward<const N: usize>(&self, shapes: [&[usize]; N], of: impl for<'t> Fn([Var<'t>; N]) -> Var<'t>) -> f64 {
        let inputs = Inputs::new(shapes);
        let mut tape = Tape::new();
        self.ms(|| {
            tape.without_gradient(|| of(inputs.on(&tape)));
            tape.reset();
        })
    }

    /// Milliseconds of the forward pass of `of` and the backward pass with respect to all inputs.
    pub fn forward_backward<const N: usize>(
        &self,
        shapes: [&[usize]; N],
        of: impl for<'t> Fn([Var<'t>; N]) -> Var<'t>,
    ) -> f64 {
        let inputs = Inputs::new(shapes);
        let mut tape = Tape::new();
        let cotangent = normal("cotangent", of(inputs.on(&tape)).shape().len());
        tape.reset();
        self.ms(|| {
            of(inputs.on(&tape)).backward_with(&cotangent);
            tape.reset();
        })
    }
}

/// Tensors that a tape shares without copying them.
struct Inputs {
    params: Params<f32>,
}

impl Inputs {
    fn new<const N: usize>(shapes: [&[usize]; N]) -> Self {
        let mut params = Params::new();
        for (i, shape) in shapes.iter().enumerate() {
            let name = format!("input {i}");
            let values = normal(&name, shape.iter().product());
            params.add(name, *shape, values);
        }
        Self { params }
    }

    fn on<'t, const N: usize>(&self, tape: &'t Tape) -> [Var<'t>; N] {
        let vars: List<Var<'t>> = self.params.ids().map(|id| tape.param(&self.params, id)).collect();
        vars.as_slice().try_into().expect("as many as there are shapes")
    }
}

/// Normal random numbers, determined by `purpose`.
pub fn normal(purpose: &str, len: usize) -> Vec<f32> {
    let stream = Stream::new(0, 0, purpose);
    (0..len as u64).map(|i| stream.normal(i)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::thread::sleep;

    #[test]
    fn short_work_is_repeated_and_long_work_is_not() {
        let (mut calls, meter) = (0, Meter::new(3));
        let ms = meter.ms(|| {
            calls += 1;
            sleep(Duration::from_millis(70));
        });
        assert!(calls == 3 + 3 && ms >= 70.0, "{calls} calls of {ms} ms");
        let mut calls = 0;
        let ms = meter.ms(|| {
            calls += 1;
            sleep(Duration::from_millis(1));
        });
        assert!(calls > 3 + 3 && ms >= 1.0, "{calls} calls of {ms} ms");
    }
}
