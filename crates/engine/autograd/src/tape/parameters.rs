//! Parameters on the tape.

use super::{Storage, Tape};
use crate::Var;
use crate::params::{ParamId, Params};
use std::cell::Ref;
use weaver_kernels::Real;

impl<T: Real> Tape<T> {
    /// A parameter as a leaf, shared without a copy; a second call for a parameter returns the same value. Frozen
    /// parameters are constants.
    ///
    /// All parameters on a tape must belong to one [`Params`], since they are identified by their ids. Use
    /// [`shared_constant`](Tape::shared_constant) for the parameters of another model, which is not trained.
    #[inline(never)]
    pub fn param(&self, params: &Params<T>, id: ParamId) -> Var<'_, T> {
        let param = params.get(id);
        let at = id.index();
        {
            let mut record = self.record.borrow_mut();
            if record.params.len() <= at {
                record.params.resize(at + 1, None);
            }
            if let Some(id) = record.params[at] {
                let shape = record.output_shapes[id as usize];
                assert_eq!(
                    shape,
                    param.shape(),
                    "{} is not of the `Params` whose parameters this tape has",
                    param.name()
                );
                let value = &mut record.values[id as usize];
                if let Storage::Released = value.storage {
                    value.storage = Storage::of(param);
                }
                return Var::new(self, id, param.shape(), value.tracked);
            }
        }
        let storage = Storage::of(param);
        let tracked = !param.is_frozen() && !matches!(storage, Storage::Half(_));
        let var = self.push_source(storage, param.shape(), tracked);
        self.record.borrow_mut().params[at] = Some(var.id());
        var
    }

    /// The gradient of a parameter after the backward pass; `None` if none reached it.
    pub fn param_grad(&self, id: ParamId) -> Option<Ref<'_, [T]>> {
        let value = self.record.borrow().params.get(id.index()).copied().flatten()?;
        self.grad(value)
    }

    /// The gradient of a parameter after the backward pass, to be changed before an optimizer uses it; `None` if none
    /// reached it.
    pub fn param_grad_mut(&mut self, id: ParamId) -> Option<&mut [T]> {
        let record = self.record.get_mut();
        let value = record.params.get(id.index()).copied().flatten()?;
        record.values[value as usize].grad.as_deref_mut()
    }

    /// Forgets the ops and releases the parameters' values, so that [`Params::value_mut`] changes them in place. Their
    /// gradients stay until [`reset`](Tape::reset). Needs the tape exclusively, so that no [`Var`] can reach a released
    /// value.
    #[inline(never)]
    pub fn release_params(&mut self) {
        let record = self.record.get_mut();
        for node in record.nodes.drain(..) {
            record.boxes.put(node.op);
        }
        for value in record.params.iter().flatten() {
            record.values[*value as usize].storage = Storage::Released;
        }
    }

    /// Multiplies the gradient of a parameter by a factor, as clipping does.
    pub fn scale_param_grad(&mut self, id: ParamId, factor: T) {
        let record = self.record.get_mut();
        let value = record.params.get(id.index()).copied().flatten();
        if let Some(gradient) = value.and_then(|value| record.values[value as usize].grad.as_mut()) {
            gradient.iter_mut().for_each(|g| *g *= factor);
        }
    }

    /// True if the parameter occurs on this tape.
    pub(crate) fn uses(&self, id: ParamId) -> bool {
        self.record.borrow().params.get(id.index()).is_some_and(Option::is_some)
    }
}
