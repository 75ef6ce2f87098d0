//! Measuring steps: their memory before a run, and a trace of their ops during one.

use crate::Error;
use serde_json::{Value, json};
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use weaver_autograd::{OpMemory, Phase, Tape};

/// The step of a stage that is traced, counted from 0: not the first ones, which allocate.
const TRACED: usize = 2;

/// Resources of a run, measured on a few steps of each stage.
#[derive(Clone, Debug, PartialEq)]
pub struct DryRun {
    /// Bytes of the parameters.
    pub parameters: usize,
    /// Bytes of the optimizer's two moments.
    pub optimizer: usize,
    /// Bytes of the averaged parameters.
    pub average: usize,
    /// Bytes that the tape allocated in all: a little more than the largest peak of a step.
    pub tape: usize,
    /// Batches of a step.
    pub batches: usize,
    /// The stages that are still to be trained.
    pub stages: Vec<StageMemory>,
}

/// The memory of a stage's steps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StageMemory {
    /// The stage.
    pub name: String,
    /// Bytes of the values that the forward pass leaves for the way back, at most.
    pub activations: usize,
    /// Bytes in use at one time within a step, gradients and scratch included, at most.
    pub peak: usize,
    /// Activations by kind of op, of the step with the most; the largest first.
    pub by_op: Vec<OpMemory>,
    /// The time of the quickest step.
    pub step: Duration,
}

impl fmt::Display for DryRun {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mb = |bytes: usize| bytes as f64 / 1e6;
        writeln!(f, "{:<28}{:>9.1} MB", "parameters", mb(self.parameters))?;
        writeln!(f, "{:<28}{:>9.1} MB", "optimizer", mb(self.optimizer))?;
        writeln!(f, "{:<28}{:>9.1} MB", "average of the parameters", mb(self.average))?;
        for stage in &self.stages {
            let ms = 1e3 * stage.step.as_secs_f64();
            writeln!(f, "stage {}, {ms:.0} ms a step", stage.name)?;
            writeln!(f, "  {:<26}{:>9.1} MB", "activations", mb(stage.activations))?;
            for op in stage.by_op.iter().take(5) {
                writeln!(f, "    {:<24}{:>9.1} MB", format!("{} x {}", op.count, op.name), mb(op.bytes))?;
            }
            writeln!(f, "  {:<26}{:>9.1} MB", "with gradients and scratch", mb(stage.peak))?;
        }
        write!(f, "{:<28}{:>9.1} MB", "tape, all stages", mb(self.tape))
    }
}

/// Watches the steps of a session.
#[derive(Debug)]
pub(crate) struct Probe {
    kind: Kind,
    /// When the step began.
    began: Instant,
    /// The parts of the step, and when each ended.
    parts: Vec<(&'static str, Duration)>,
}

#[derive(Debug)]
enum Kind {
    Memory(StageMemory),
    Trace {
        path: PathBuf,
        /// The events of the stages traced so far, and how many stages.
        events: Vec<Value>,
        stages: usize,
        /// The stage of the step that is being traced.
        stage: Option<String>,
    },
}

impl Probe {
    pub(crate) fn memory() -> Self {
        Self { kind: Kind::Memory(StageMemory::default()), began: Instant::now(), parts: Vec::new() }
    }

    pub(crate) fn trace(path: &Path) -> Self {
        let kind = Kind::Trace { path: path.to_path_buf(), events: Vec::new(), stages: 0, stage: None };
        Self { kind, began: Instant::now(), parts: Vec::new() }
    }

    /// The memory of the stage that was watched.
    pub(crate) fn into_stage(self) -> Option<StageMemory> {
        match self.kind {
            Kind::Memory(stage) => Some(stage),
            Kind::Trace { .. } => None,
        }
    }

    /// Step `local` of a stage begins; the tape is empty.
    pub(crate) fn begin(&mut self, name: &str, steps: usize, local: usize, tape: &Tape<f32>) {
        match &mut self.kind {
            Kind::Memory(memory) => {
                memory.name = name.to_string();
                tape.pool().reset_peak();
            }
            Kind::Trace { stage, .. } if local == TRACED.min(steps - 1) => {
                *stage = Some(name.to_string());
                tape.set_tracing(true);
            }
            Kind::Trace { .. } => {}
        }
        self.parts.clear();
        self.began = Instant::now();
    }

    /// A part of the step is done.
    pub(crate) fn done(&mut self, part: &'static str) {
        self.parts.push((part, self.began.elapsed()));
    }

    /// The forward pass is done: all values now on the tape are needed for the backward pass.
    pub(crate) fn held(&mut self, tape: &Tape<f32>) {
        if let Kind::Memory(memory) = &mut self.kind {
            let used = tape.pool().used_bytes();
            if used > memory.activations {
                memory.activations = used;
                memory.by_op = tape.memory();
            }
        }
    }

    /// The step is done.
    pub(crate) fn end(&mut self, tape: &Tape<f32>) -> Result<(), Error> {
        let took = self.began.elapsed();
        match &mut self.kind {
            Kind::Memory(memory) => {
                memory.peak = memory.peak.max(tape.pool().peak_bytes());
                memory.step = if memory.step.is_zero() { took } else { memory.step.min(took) };
            }
            Kind::Trace { path, events, stages, stage } => {
                if let Some(stage) = stage.take() {
                    events.extend(chrome_events(&stage, *stages, &self.parts, tape));
                    *stages += 1;
                    tape.set_tracing(false);
                    let trace = json!({ "displayTimeUnit": "ms", "traceEvents": events });
                    weaver_io::write_text(path, &trace.to_string())?;
                }
            }
        }
        Ok(())
    }
}

/// A stage as a process with three threads: the parts of the step, ops forward, ops backward.
fn chrome_events(stage: &str, process: usize, parts: &[(&str, Duration)], tape: &Tape<f32>) -> Vec<Value> {
    let micros = |t: Duration| t.as_secs_f64() * 1e6;
    let name = |what: &str, thread: usize, name: &str| json!({ "ph": "M", "name": what, "pid": process, "tid": thread, "args": { "name": name } });
    let span = |name: &str, thread: usize, start: Duration, duration: Duration, path: &str| {
        json!({
            "ph": "X", "name": name, "cat": LANES[thread], "pid": process, "tid": thread,
            "ts": micros(start), "dur": micros(duration), "args": { "path": path },
        })
    };
    let mut events = vec![name("process_name", 0, &format!("a step of stage {stage}"))];
    events.extend(LANES.iter().enumerate().map(|(thread, lane)| name("thread_name", thread, lane)));
    let mut start = Duration::ZERO;
    for (part, end) in parts {
        events.push(span(part, 0, start, *end - start, ""));
        start = *end;
    }
    for event in tape.trace() {
        // Recomputation belongs to the backward pass, inside the event of its checkpoint.
        let thread = if matches!(event.phase, Phase::Backward | Phase::Recompute) { 2 } else { 1 };
        events.push(span(event.name, thread, event.start, event.duration, &event.path));
    }
    events
}

const LANES: [&str; 3] = ["step", "forward", "backward"];
