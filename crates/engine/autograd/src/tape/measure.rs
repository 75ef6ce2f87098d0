//! Measurements: the time of ops, a trace of them, the memory they hold, and the values they computed.

use super::{List, Storage, Tape};
use crate::profile::{OpMemory, OpTime, Phase, Profile, TraceEvent};
use crate::{Op, View};
use std::time::Instant;
use weaver_kernels::Real;

impl<T: Real> Tape<T> {
    /// Starts or stops measuring where time goes; see [`Tape::op_times`]. Starting forgets earlier times.
    pub fn set_profiling(&self, on: bool) {
        *self.profile.borrow_mut() = on.then(Profile::default);
    }

    /// The time spent in each kind of op since profiling was started; empty when it is off. Survives
    /// [`reset`](Tape::reset).
    pub fn op_times(&self) -> Vec<OpTime> {
        self.profile.borrow().clone().map_or_else(Vec::new, Profile::into_times)
    }

    /// Starts or stops recording a trace of every op as it runs; see [`Tape::trace`]. Starting forgets an earlier
    /// trace.
    pub fn set_tracing(&self, on: bool) {
        self.tracer.set(on);
    }

    /// Every op that ran since tracing was started, forward and backward, in the order in which they ended, including
    /// those inside other ops ([`checkpoint`](crate::ops::checkpoint)); empty when tracing is off. Survives
    /// [`reset`](Tape::reset).
    pub fn trace(&self) -> Vec<TraceEvent> {
        self.tracer.trace().as_ref().map_or_else(Vec::new, |trace| trace.events.clone())
    }

    /// Runs code that is not an op and counts its time under `name` when profiling or tracing is on.
    pub fn timed<R>(&self, name: &'static str, f: impl FnOnce() -> R) -> R {
        let began = self.began();
        let result = f();
        if began.is_some() {
            self.ended(began, name, Phase::Part, self.record.borrow().path());
        }
        result
    }

    /// The present time, if profiling or tracing is on.
    pub(super) fn began(&self) -> Option<Instant> {
        (self.profile.borrow().is_some() || self.tracer.trace().is_some()).then(Instant::now)
    }

    /// Records the time since `began`.
    pub(super) fn ended(&self, began: Option<Instant>, name: &'static str, phase: Phase, path: &str) {
        let Some(began) = began else { return };
        let duration = began.elapsed();
        if let Some(profile) = &mut *self.profile.borrow_mut() {
            match phase {
                Phase::Backward => profile.backward(name, duration),
                Phase::Forward | Phase::Recompute | Phase::Part => profile.forward(name, duration),
            }
        }
        if let Some(trace) = &mut *self.tracer.trace() {
            let phase = if self.again && phase == Phase::Forward { Phase::Recompute } else { phase };
            trace.add(name, path, phase, began, duration);
        }
    }

    /// The memory held by each kind of op that is on the tape now, the largest first: outputs and tensors saved for the
    /// backward pass. Scratch memory and gradients are not included; [`Pool::peak_bytes`](crate::Pool::peak_bytes)
    /// counts everything.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f32>::new();
    /// let x = tape.leaf(&[0.5; 1000], [1000]);
    /// let y = (x * 2.0).sum();
    /// // Buffers come in steps of a quarter of an octave, and a cache line to begin at one.
    /// assert_eq!(tape.memory()[0].bytes, 4 * 1024 + 64);
    /// y.backward();
    /// assert!(tape.pool().peak_bytes() >= 3 * 4000);
    /// ```
    pub fn memory(&self) -> Vec<OpMemory> {
        let record = self.record.borrow();
        let mut list: Vec<OpMemory> = Vec::new();
        let mut add = |name: &'static str, bytes: usize| match list.iter_mut().find(|m| m.name == name) {
            Some(of_name) => {
                of_name.count += 1;
                of_name.bytes += bytes;
            }
            None => list.push(OpMemory { name, count: 1, bytes }),
        };
        let mut made = 0;
        for node in &record.nodes {
            // Values between two nodes' outputs were made by no recorded op.
            record.values[made..node.outputs.start as usize]
                .iter()
                .for_each(|v| add(SOURCES, v.storage.pooled_bytes()));
            add(node.op.op().name(), node.held);
            made = node.outputs.end as usize;
        }
        record.values[made..].iter().for_each(|v| add(SOURCES, v.storage.pooled_bytes()));
        list.sort_by_key(|m| std::cmp::Reverse(m.bytes));
        list
    }

    /// Calls `see` with every recorded op and its outputs, in the order in which they ran: to look for values that are
    /// not finite, for instance, or for rectifiers whose outputs are all zero. `see` must not apply ops to this tape.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f32>::new();
    /// let x = tape.leaf(&[-1.0, 2.0, -3.0], [3]);
    /// tape.part("layer", || x.relu());
    /// let mut silent = Vec::new();
    /// tape.for_each_node(|node| {
    ///     let zeros = node.outputs[0].iter().filter(|y| **y == 0.0).count();
    ///     silent.push(format!("{} at {}: {zeros} of {}", node.op.name(), node.path, node.outputs[0].len()));
    /// });
    /// assert_eq!(silent, ["Relu at layer: 2 of 3"]);
    /// ```
    pub fn for_each_node(&self, mut see: impl FnMut(NodeView<'_, T>)) {
        let record = self.record.borrow();
        for node in &record.nodes {
            let outputs = node.outputs.start as usize..node.outputs.end as usize;
            see(NodeView {
                op: node.op.op(),
                path: &record.paths[node.path.start as usize..node.path.end as usize],
                outputs: outputs.map(|o| record.values[o].storage.view(record.output_shapes[o])).collect(),
            });
        }
    }
}

/// A recorded op, as [`Tape::for_each_node`] shows it.
#[derive(Clone, Debug)]
pub struct NodeView<'a, T: Real> {
    /// The op itself.
    pub op: &'a dyn Op<T>,
    /// Its place in the model.
    pub path: &'a str,
    /// Its outputs; auxiliary ones come last.
    pub outputs: List<View<'a, T>>,
}

/// The name under which values that no recorded op computed are counted.
const SOURCES: &str = "leaves and constants";

impl<T: Real> Storage<T> {
    fn pooled_bytes(&self) -> usize {
        match self {
            Self::Pooled(buffer) => buffer.counted_bytes(),
            _ => 0,
        }
    }
}
