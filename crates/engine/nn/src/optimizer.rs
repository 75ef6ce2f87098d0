//! The common interface of optimizers: a state that checkpoints hold.

use crate::adamw::checked;
use crate::{AdamW, Moments, RAdam, StateError};
use std::collections::BTreeMap;
use weaver_autograd::{Params, Real};

/// An optimizer whose state can be taken and given back, so that training goes on to the same bits.
pub trait Optimizer<T: Real> {
    /// The state of every parameter that has taken a step, by name: the number of its steps and its moments.
    fn state<'a>(&'a self, params: &'a Params<T>) -> Box<dyn Iterator<Item = (&'a str, u64, &'a Moments<T>)> + 'a>;

    /// Replaces the state by one read back; parameters that are not in it begin anew.
    ///
    /// # Errors
    /// The name of a parameter that is unknown or of another size.
    fn set_state(&mut self, params: &Params<T>, state: BTreeMap<String, (u64, Moments<T>)>) -> Result<(), StateError>;
}

macro_rules! optimizer {
    ($kind:ident) => {
        impl<T: Real> Optimizer<T> for $kind<T> {
            fn state<'a>(
                &'a self,
                params: &'a Params<T>,
            ) -> Box<dyn Iterator<Item = (&'a str, u64, &'a Moments<T>)> + 'a> {
                let with_state = params.iter().zip(&self.state).filter(|(_, (steps, _))| *steps > 0);
                Box::new(with_state.map(|((_, param), (steps, moments))| (param.name(), *steps, moments)))
            }

            fn set_state(
                &mut self,
                params: &Params<T>,
                state: BTreeMap<String, (u64, Moments<T>)>,
            ) -> Result<(), StateError> {
                self.state = checked(params, state)?;
                Ok(())
            }
        }
    };
}

optimizer!(AdamW);
optimizer!(RAdam);
