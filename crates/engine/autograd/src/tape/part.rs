//! Parts of a model: an author names the results of a part, and while nothing is recorded the rest of its memory is
//! given back.

use super::{List, Storage, Tape, ValueId};
use crate::{Buffer, Var};
use smallvec::{Array, SmallVec};
use std::fmt::Display;
use weaver_kernels::Real;

/// The result of a part of a model: anything whose tensors can be listed.
///
/// Implemented for tensors, buffers of the pool (which hold none), and tuples, arrays, lists and options of such. A
/// struct of tensors implements it with one line:
///
/// ```
/// use weaver_autograd::{Outputs, Real, Tape, Var};
///
/// struct Maps<'t, T: Real> {
///     depth: Var<'t, T>,
///     confidence: Option<Var<'t, T>>,
/// }
///
/// impl<T: Real> Outputs<T> for Maps<'_, T> {
///     fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
///         (self.depth, self.confidence).for_each_var(visit);
///     }
/// }
///
/// let tape = Tape::<f32>::new();
/// let maps = tape.part("head", || Maps { depth: tape.scalar(2.0) * 3.0, confidence: None });
/// assert_eq!(maps.depth.item(), 6.0);
/// ```
pub trait Outputs<T: Real> {
    /// Calls `visit` with every tensor in it.
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>));
}

impl<T: Real> Outputs<T> for Var<'_, T> {
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
        visit(*self);
    }
}

impl<T: Real, X: Copy + Send + 'static> Outputs<T> for Buffer<X> {
    fn for_each_var(&self, _visit: &mut dyn FnMut(Var<'_, T>)) {}
}

impl<T: Real, X: Outputs<T>> Outputs<T> for Option<X> {
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
        self.iter().for_each(|x| x.for_each_var(visit));
    }
}

impl<T: Real, X: Outputs<T>> Outputs<T> for [X] {
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
        self.iter().for_each(|x| x.for_each_var(visit));
    }
}

impl<T: Real, X: Outputs<T>, const N: usize> Outputs<T> for [X; N] {
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
        self.as_slice().for_each_var(visit);
    }
}

impl<T: Real, X: Outputs<T>> Outputs<T> for Vec<X> {
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
        self.as_slice().for_each_var(visit);
    }
}

impl<T: Real, A: Array<Item: Outputs<T>>> Outputs<T> for SmallVec<A> {
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
        self.as_slice().for_each_var(visit);
    }
}

macro_rules! tuples {
    ($(($($name:ident $index:tt),*))*) => { $(
        impl<T: Real, $($name: Outputs<T>),*> Outputs<T> for ($($name,)*) {
            fn for_each_var(&self, _visit: &mut dyn FnMut(Var<'_, T>)) {
                $(self.$index.for_each_var(_visit);)*
            }
        }
    )* };
}

tuples!(()(A 0)(A 0, B 1)(A 0, B 1, C 2)(A 0, B 1, C 2, D 3)(A 0, B 1, C 2, D 3, E 4)(A 0, B 1, C 2, D 3, E 4, F 5));

/// Steps of a computation one behind the other; made by [`Tape::steps`].
#[derive(Debug)]
#[must_use = "`end` returns what the last step did"]
pub struct Steps<'t, T: Real, R> {
    tape: &'t Tape<T>,
    /// Number of values that the tape had before the first step.
    start: usize,
    latest: R,
}

impl<'t, T: Real, R> Steps<'t, T, R> {
    /// Runs the next step on the result of the latest one. While nothing is recorded, the memory of everything computed
    /// since the first step is then given back, but for this step's result.
    pub fn then<S: Outputs<T>>(self, step: impl FnOnce(R) -> S) -> Steps<'t, T, S> {
        let Self { tape, start, latest } = self;
        let latest = step(latest);
        tape.release_since(start, &latest);
        Steps { tape, start, latest }
    }

    /// The result of the last step.
    pub fn end(self) -> R {
        self.latest
    }
}

impl<T: Real> Tape<T> {
    /// Runs a part of a model: `name` is appended to the model path that messages and profiles show (`encoder`, then
    /// `encoder.block`, ...). While nothing is recorded ([`without_gradient`](Self::without_gradient)), only the result
    /// of the part stays in memory; reading anything else that it computed then panics. While recording, everything
    /// stays for the backward pass.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f32>::new();
    /// let x = tape.constant(&[1.0, 2.0], [2]);
    /// let y = tape.without_gradient(|| tape.part("square", || (x + 1.0) * (x + 1.0)));
    /// assert_eq!(y.to_vec(), [4.0, 9.0]);
    /// ```
    pub fn part<R: Outputs<T>>(&self, name: impl Display, f: impl FnOnce() -> R) -> R {
        let _path = self.append_path(name);
        self.steps(f).end()
    }

    /// Runs a part of a model by its full path, which takes the place of the model path; an empty one changes nothing.
    /// Of the part's memory only its outputs stay, as of [`part`](Self::part)'s.
    pub fn part_at<R: Outputs<T>>(&self, path: &str, f: impl FnOnce() -> R) -> R {
        let _path = self.replace_path(path);
        self.steps(f).end()
    }

    /// Runs the first of several steps, each of which gets the result of the one before ([`Steps::then`]). While
    /// nothing is recorded, only the latest result stays in memory, so a step has to hand on every value that a later
    /// step needs.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f32>::new();
    /// let x = tape.constant(&[1.0, 2.0], [2]);
    /// let y = tape.without_gradient(|| tape.steps(|| x * x).then(|y| (y, y + 1.0)).then(|(y, z)| y * z).end());
    /// assert_eq!(y.to_vec(), [2.0, 20.0]);
    /// ```
    pub fn steps<R: Outputs<T>>(&self, first: impl FnOnce() -> R) -> Steps<'_, T, R> {
        let start = self.record.borrow().values.len();
        Steps { tape: self, start, latest: () }.then(|()| first())
    }

    /// Runs `f` for each item on the result for the item before, as [`Iterator::fold`] does, beginning with the result
    /// of `first`; while nothing is recorded, only the latest result stays in memory: for layers one behind the other.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f32>::new();
    /// let x = tape.constant(&[1.0, 2.0], [2]);
    /// let y = tape.without_gradient(|| tape.fold(|| x, 0..100, |x, _| x * 0.5 + 1.0));
    /// assert_eq!(y.to_vec(), [2.0, 2.0]);
    /// ```
    pub fn fold<R: Outputs<T>, I: IntoIterator>(
        &self,
        first: impl FnOnce() -> R,
        items: I,
        mut f: impl FnMut(R, I::Item) -> R,
    ) -> R {
        items.into_iter().fold(self.steps(first), |steps, item| steps.then(|latest| f(latest, item))).end()
    }

    /// Runs `f` for each item; while nothing is recorded, nothing of it stays in memory: for results that are copied
    /// elsewhere piece by piece.
    pub fn for_each<I: IntoIterator>(&self, items: I, mut f: impl FnMut(I::Item)) {
        self.fold(|| (), items, |(), item| f(item));
    }

    /// While nothing is recorded, gives back the memory of every value from index `start` on but those in `outputs`.
    fn release_since(&self, start: usize, outputs: &impl Outputs<T>) {
        if self.recording.get() {
            return;
        }
        let mut kept: List<ValueId> = List::new();
        outputs.for_each_var(&mut |var| kept.push(var.id()));
        let values = &mut self.record.borrow_mut().values[start..];
        for (value, id) in values.iter_mut().zip(start as ValueId..) {
            if !kept.contains(&id) {
                value.storage = Storage::Released;
            }
        }
    }

    /// True if applied ops are recorded.
    pub fn is_recording(&self) -> bool {
        self.recording.get()
    }
}
