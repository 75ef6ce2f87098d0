//! Named parameters, apart from any tape.

use crate::Shape;
use std::sync::Arc;
use weaver_kernels::Real;

/// The index of a parameter in its [`Params`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ParamId(u32);

impl ParamId {
    /// Its position: parameters are numbered in the order in which they were added.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// One trainable tensor.
#[derive(Clone, Debug)]
pub struct Param<T: Real> {
    name: String,
    shape: Shape,
    value: Arc<Vec<T>>,
    frozen: bool,
}

impl<T: Real> Param<T> {
    /// Its full name, such as `encoder.block.3.attn.qkv.weight`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its dimensions.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// Its numbers.
    pub fn value(&self) -> &[T] {
        &self.value
    }

    /// Whether it is left out of the tape's gradients.
    pub fn is_frozen(&self) -> bool {
        self.frozen
    }

    pub(crate) fn shared(&self) -> Arc<Vec<T>> {
        self.value.clone()
    }
}

/// The parameters of a model: an ordered list of named tensors. A clone shares them until either is changed.
#[derive(Clone, Debug, Default)]
pub struct Params<T: Real = f32> {
    list: Arc<Vec<Param<T>>>,
}

impl<T: Real> Params<T> {
    /// No parameters.
    pub fn new() -> Self {
        Self { list: Arc::default() }
    }

    /// Adds a parameter; panics if the name is taken or the sizes disagree (both are programming errors).
    pub fn add(&mut self, name: impl Into<String>, shape: impl Into<Shape>, value: Vec<T>) -> ParamId {
        let (name, shape) = (name.into(), shape.into());
        assert_eq!(value.len(), shape.len(), "parameter {name} of shape {shape}");
        assert!(self.find(&name).is_none(), "two parameters are named {name}");
        Arc::make_mut(&mut self.list).push(Param { name, shape, value: Arc::new(value), frozen: false });
        ParamId(self.list.len() as u32 - 1)
    }

    /// The parameter with this id.
    pub fn get(&self, id: ParamId) -> &Param<T> {
        &self.list[id.index()]
    }

    /// The parameter with this name.
    pub fn find(&self, name: &str) -> Option<ParamId> {
        self.list.iter().position(|p| p.name == name).map(|i| ParamId(i as u32))
    }

    /// The numbers of a parameter, to change them. A tape that still shares them keeps the old ones (and the change
    /// then costs a copy): reset it first, or let it [release](crate::Tape::release_params) them.
    pub fn value_mut(&mut self, id: ParamId) -> &mut [T] {
        let value: &mut Vec<T> = Arc::make_mut(&mut Arc::make_mut(&mut self.list)[id.index()].value);
        value
    }

    /// Leaves a parameter out of training, or takes it in again.
    pub fn set_frozen(&mut self, id: ParamId, frozen: bool) {
        Arc::make_mut(&mut self.list)[id.index()].frozen = frozen;
    }

    /// All parameters in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (ParamId, &Param<T>)> {
        self.list.iter().enumerate().map(|(i, p)| (ParamId(i as u32), p))
    }

    /// The ids of all parameters in order; they do not borrow, so values can be changed on the way.
    pub fn ids(&self) -> impl ExactSizeIterator<Item = ParamId> + use<T> {
        (0..self.list.len()).map(|i| ParamId(i as u32))
    }

    /// How many tensors there are.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// How many numbers there are in all.
    pub fn count(&self) -> usize {
        self.list.iter().map(|p| p.value.len()).sum()
    }
}
