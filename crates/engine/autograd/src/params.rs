//! Named parameters, which exist independently of any tape.

use crate::Shape;
use half::{bf16, f16};
use std::fmt;
use std::sync::Arc;
use weaver_kernels::Real;
use weaver_kernels::gemm::Half;

/// The index of a parameter in its [`Params`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ParamId(u32);

impl ParamId {
    /// Its position: parameters are numbered in the order in which they were added.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// The storage of a parameter's values.
#[derive(Clone)]
pub enum ParamValues<T: Real> {
    /// Memory that the parameter owns; clones share it until one changes.
    Owned(Arc<Vec<T>>),
    /// Memory that is owned elsewhere, such as a mapped file.
    Shared(Arc<dyn AsRef<[T]> + Send + Sync>),
    /// Half precision: a constant, for layers that multiply by it.
    Half(HalfValues),
    /// No values yet: the parameter has only been declared.
    Absent,
}

/// Values in half precision, in memory that may be shared.
#[derive(Clone)]
pub enum HalfValues {
    /// bf16, converted to full precision while a product reads it.
    Bf16(Arc<dyn AsRef<[bf16]> + Send + Sync>),
    /// bf16; where the processor can multiply pairs of bf16 at twice the speed, products round the other factor to
    /// bf16, too. [`Half::Bf16Pairs`] states the loss of precision.
    Bf16Pairs(Arc<dyn AsRef<[bf16]> + Send + Sync>),
    /// f16, converted to full precision while a product reads it.
    F16(Arc<dyn AsRef<[f16]> + Send + Sync>),
}

impl fmt::Debug for HalfValues {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Bf16(_) => "Bf16",
            Self::Bf16Pairs(_) => "Bf16Pairs",
            Self::F16(_) => "F16",
        })
    }
}

impl HalfValues {
    /// Borrows the values.
    pub fn view(&self) -> Half<'_> {
        match self {
            Self::Bf16(values) => Half::Bf16((**values).as_ref()),
            Self::Bf16Pairs(values) => Half::Bf16Pairs((**values).as_ref()),
            Self::F16(values) => Half::F16((**values).as_ref()),
        }
    }
}

impl<T: Real> fmt::Debug for ParamValues<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Owned(_) => "Owned",
            Self::Shared(_) => "Shared",
            Self::Half(values) => return values.fmt(f),
            Self::Absent => "Absent",
        })
    }
}

impl<T: Real> ParamValues<T> {
    fn len(&self) -> usize {
        match self {
            Self::Owned(values) => values.len(),
            Self::Shared(values) => (**values).as_ref().len(),
            Self::Half(values) => values.view().len(),
            Self::Absent => 0,
        }
    }
}

/// One trainable tensor.
#[derive(Clone, Debug)]
pub struct Param<T: Real> {
    name: String,
    shape: Shape,
    values: ParamValues<T>,
    frozen: bool,
}

impl<T: Real> Param<T> {
    /// The full name, such as `encoder.block.3.attn.qkv.weight`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The shape.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// The values.
    ///
    /// # Panics
    ///
    /// If the parameter has no values yet, or has them in half precision.
    pub fn value(&self) -> &[T] {
        match &self.values {
            ParamValues::Owned(values) => values,
            ParamValues::Shared(values) => (**values).as_ref(),
            ParamValues::Half(_) => panic!("parameter {} is stored in half precision", self.name),
            ParamValues::Absent => panic!("parameter {} has no values yet", self.name),
        }
    }

    /// The storage of the values.
    pub fn values(&self) -> &ParamValues<T> {
        &self.values
    }

    /// True if the parameter is frozen, that is, a constant on the tape.
    pub fn is_frozen(&self) -> bool {
        self.frozen
    }
}

/// The parameters of a model: an ordered list of named tensors. A clone shares the values until either copy changes.
#[derive(Clone, Debug, Default)]
pub struct Params<T: Real = f32> {
    list: Arc<Vec<Param<T>>>,
}

impl<T: Real> Params<T> {
    /// Creates an empty list.
    pub fn new() -> Self {
        Self { list: Arc::default() }
    }

    /// Adds a parameter. Panics if the name is taken or the number of values does not match the shape.
    pub fn add(&mut self, name: impl Into<String>, shape: impl Into<Shape>, value: Vec<T>) -> ParamId {
        let (name, shape) = (name.into(), shape.into());
        assert_eq!(value.len(), shape.len(), "parameter {name} of shape {shape}");
        assert!(self.find(&name).is_none(), "two parameters are named {name}");
        self.push(Param { name, shape, values: ParamValues::Owned(Arc::new(value)), frozen: false })
    }

    /// Adds a parameter whose values must be [set](Params::set) before it is used. Panics if the name is taken.
    pub fn declare(&mut self, name: impl Into<String>, shape: impl Into<Shape>) -> ParamId {
        let (name, shape) = (name.into(), shape.into());
        assert!(self.find(&name).is_none(), "two parameters are named {name}");
        self.push(Param { name, shape, values: ParamValues::Absent, frozen: false })
    }

    fn push(&mut self, param: Param<T>) -> ParamId {
        Arc::make_mut(&mut self.list).push(param);
        ParamId(self.list.len() as u32 - 1)
    }

    /// Replaces the values of a parameter without a copy. Panics if there are more or fewer than its shape needs.
    pub fn set(&mut self, id: ParamId, values: ParamValues<T>) {
        let param = &mut Arc::make_mut(&mut self.list)[id.index()];
        assert_eq!(values.len(), param.shape.len(), "values of parameter {} of shape {}", param.name, param.shape);
        param.values = values;
    }

    /// The parameter with this id.
    pub fn get(&self, id: ParamId) -> &Param<T> {
        &self.list[id.index()]
    }

    /// The id of the parameter with this name.
    pub fn find(&self, name: &str) -> Option<ParamId> {
        self.list.iter().position(|p| p.name == name).map(|i| ParamId(i as u32))
    }

    /// Borrows the values of a parameter to change them. A tape that still shares them keeps the old ones, which costs
    /// a copy: reset the tape first, or let it [release](crate::Tape::release_params) the values.
    ///
    /// Values in shared memory or in half precision are copied first. Panics if the parameter has no values yet.
    pub fn value_mut(&mut self, id: ParamId) -> &mut [T] {
        let param = &mut Arc::make_mut(&mut self.list)[id.index()];
        match &param.values {
            ParamValues::Owned(_) => {}
            ParamValues::Half(values) => {
                let mut wide = vec![T::ZERO; param.shape.len()];
                values.view().widen(&mut wide);
                param.values = ParamValues::Owned(Arc::new(wide));
            }
            _ => param.values = ParamValues::Owned(Arc::new(param.value().to_vec())),
        }
        match &mut param.values {
            ParamValues::Owned(values) => {
                let values: &mut Vec<T> = Arc::make_mut(values);
                values
            }
            _ => unreachable!("they are owned now"),
        }
    }

    /// Excludes a parameter from training (`true`) or includes it again: a frozen parameter is a constant on the tape.
    pub fn set_frozen(&mut self, id: ParamId, frozen: bool) {
        Arc::make_mut(&mut self.list)[id.index()].frozen = frozen;
    }

    /// All parameters in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (ParamId, &Param<T>)> {
        self.list.iter().enumerate().map(|(i, p)| (ParamId(i as u32), p))
    }

    /// The ids of all parameters in order. The iterator does not borrow the list, so values can be changed while it
    /// runs.
    pub fn ids(&self) -> impl ExactSizeIterator<Item = ParamId> + use<T> {
        (0..self.list.len()).map(|i| ParamId(i as u32))
    }

    /// Number of parameters.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// True if there are no parameters.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Number of elements of all parameters together.
    pub fn count(&self) -> usize {
        self.list.iter().map(|p| p.shape.len()).sum()
    }
}
