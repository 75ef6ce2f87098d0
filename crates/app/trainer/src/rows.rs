//! Parameters that grow and shrink while they are trained.

use crate::Error;
use std::ops::Deref;
use weaver_autograd::{ParamId, Params, Tape};
use weaver_nn::{AdamW, Ema, RowError, RowMap, RowSource};

/// The parameters of a run between two steps, for [`Recipe::resize`](crate::Recipe::resize) to change their rows.
#[derive(Debug)]
pub struct TrainedRows<'a> {
    pub(crate) params: &'a mut Params<f32>,
    pub(crate) optimizer: &'a mut AdamW<f32>,
    pub(crate) ema: &'a mut Ema<f32>,
    pub(crate) tape: &'a Tape<f32>,
}

impl TrainedRows<'_> {
    /// The parameters after the step.
    pub fn params(&self) -> &Params<f32> {
        self.params
    }

    /// The gradient of the step, with the rows that the parameter had in it; `None` where none reached the parameter.
    pub fn gradient(&self, id: ParamId) -> Option<impl Deref<Target = [f32]>> {
        self.tape.param_grad(id)
    }

    /// Gives a parameter other rows: its values, the optimizer's moments and the average together. `new` is called with
    /// the index and the numbers, zeros, of each [new](RowSource::New) row.
    ///
    /// Panics unless the rows of the parameter [vary](Params::set_rows_vary).
    ///
    /// # Errors
    /// When the parameter does not have the rows that the map begins with; nothing is then changed.
    pub fn remap(&mut self, id: ParamId, map: &RowMap, mut new: impl FnMut(usize, &mut [f32])) -> Result<(), Error> {
        let wrong = |error: RowError| Error::Input(error.to_string());
        map.apply(self.params, id).map_err(wrong)?;
        let width: usize = self.params.get(id).shape().dims()[1..].iter().product();
        let rows = self.params.value_mut(id).chunks_exact_mut(width.max(1)).enumerate();
        for ((row, numbers), _) in rows.zip(map.sources()).filter(|(_, source)| **source == RowSource::New) {
            new(row, numbers);
        }
        self.optimizer.remap_rows(self.params, id, map).map_err(wrong)?;
        self.ema.remap_rows(self.params, id, map).map_err(wrong)
    }
}
