//! An op of one's own, y = x s with a number s for each row, and the check of its gradient.

use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Tape, Var, View, ViewMut, ensure_shape};

#[derive(Debug)]
struct ScaleRows;

impl<T: Real> Op<T> for ScaleRows {
    fn name(&self) -> &'static str {
        "scale_rows"
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 2 && ins[0].rank() == 2 && ins[1] == Shape::from([ins[0][0]]), "x [N, D], s [N]");
        Ok(Shapes::one(ins[0]))
    }

    fn forward(&mut self, ins: &[View<T>], outs: &mut [ViewMut<T>], _: &Pool) {
        let (x, s, width) = (&ins[0], &ins[1], ins[0].shape().last());
        outs[0].iter_mut().enumerate().for_each(|(i, y)| *y = s[i / width] * x[i]);
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        let (x, s, dy, width) = (&ins[0], &ins[1], &douts[0], ins[0].shape().last());
        if let Some(dx) = &mut dins[0] {
            dx.add_each(|i| s[i / width] * dy[i]);
        }
        if let Some(ds) = &mut dins[1] {
            ds.add_each(|n| (n * width..(n + 1) * width).map(|i| x[i] * dy[i]).sum());
        }
    }
}

fn scale_rows<'t, T: Real>(x: Var<'t, T>, s: Var<'t, T>) -> Var<'t, T> {
    let [y] = x.tape().apply(ScaleRows, &[x, s]);
    y
}

fn main() {
    let tape = Tape::<f32>::new();
    let (x, s) = (tape.leaf(&[1.0, 2.0, 3.0, 4.0], [2, 2]), tape.leaf(&[10.0, 100.0], [2]));
    let y = scale_rows(x, s);
    assert_eq!(y.to_vec(), [10.0, 20.0, 300.0, 400.0]);
    y.sum().backward();
    assert_eq!(s.grad().expect("a leaf"), [3.0, 7.0]);

    gradcheck(&[Input::normal(1, [3, 4]), Input::normal(2, [3])], |x| vec![scale_rows(x[0], x[1])]);
    println!("y = {:?}; the gradient is that of the function", y.to_vec());
}
