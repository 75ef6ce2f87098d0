//! Exponential moving averages of the parameters over the steps of training.

use crate::StateError;
use std::collections::BTreeMap;
use weaver_autograd::{Params, Real};
use weaver_kernels::optim::lerp;

/// An exponential moving average of all parameters: a = d a + (1 - d) p after every step, with
/// d = min(decay, (k + 1) / (k + 10)) at step k, so that early steps are soon forgotten.
///
/// ```
/// use weaver_autograd::Params;
/// use weaver_nn::Ema;
/// let mut params = Params::<f64>::new();
/// let w = params.add("w", [1], vec![0.0]);
/// let mut ema = Ema::new(&params, 0.999);
/// params.value_mut(w)[0] = 10.0; // a step
/// ema.update(&params);
/// ema.swap(&mut params);
/// assert_eq!(params.get(w).value(), [9.0]);
/// ```
#[derive(Clone, Debug)]
pub struct Ema<T: Real = f32> {
    /// The largest decay per step.
    pub decay: f64,
    steps: u64,
    average: Vec<Vec<T>>,
}

impl<T: Real> Ema<T> {
    /// An average that begins at the parameters as they are. Panics if one has no values, or has them in half
    /// precision.
    pub fn new(params: &Params<T>, decay: f64) -> Self {
        Self { decay, steps: 0, average: params.iter().map(|(_, p)| p.value().to_vec()).collect() }
    }

    /// Updates the averages with the parameters after a step.
    pub fn update(&mut self, params: &Params<T>) {
        let k = self.steps as f64;
        let decay = T::from_f64(self.decay.min((k + 1.0) / (k + 10.0)));
        for ((_, param), average) in params.iter().zip(&mut self.average) {
            lerp(average, param.value(), decay);
        }
        self.steps += 1;
    }

    /// Exchanges the parameters and their averages: once to evaluate with the averages, once more to go on training.
    pub fn swap(&mut self, params: &mut Params<T>) {
        for (id, average) in params.ids().zip(&mut self.average) {
            params.value_mut(id).swap_with_slice(average);
        }
    }

    /// The number of [`update`](Self::update)s.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// The averages by name.
    pub fn state<'a>(&'a self, params: &'a Params<T>) -> impl Iterator<Item = (&'a str, &'a [T])> {
        params.iter().zip(&self.average).map(|((_, p), average)| (p.name(), average.as_slice()))
    }

    /// Replaces the averages and the number of steps by stored ones. Fails with the name of a parameter that is unknown
    /// or of another size.
    pub fn set_state(
        &mut self,
        params: &Params<T>,
        steps: u64,
        averages: BTreeMap<String, Vec<T>>,
    ) -> Result<(), StateError> {
        for (name, average) in averages {
            let Some(id) = params.find(&name) else { return Err(StateError::Unknown { name }) };
            let (expected, found) = (params.get(id).shape().len(), average.len());
            if expected != found {
                return Err(StateError::Size { name, expected, found });
            }
            self.average[id.index()] = average;
        }
        self.steps = steps;
        Ok(())
    }
}
