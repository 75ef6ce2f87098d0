//! The training loop.

mod batches;
mod examples;
mod frozen;
mod plan;
mod train;

pub(crate) use train::SAMPLES;

use crate::dry_run::{DryRun, Probe};
use crate::evaluate::{self, Options};
use crate::losses::ImageNetworks;
use crate::sources::Sources;
use crate::{Alone, Config, Error, Ranks, Recipe, StageConfig, Step, TrainingState, initial, scenes};
use batches::Batch;
use std::path::Path;
use std::sync::Arc;
use weaver_autograd::{OpTime, Params, Tape};
use weaver_data::{Layout, Scene};
use weaver_inference::{Checkpoint, Predictor};
use weaver_io::Advice;
use weaver_kernels::random::{Stream, fnv1a};
use weaver_nn::{AdamW, Context, Ema, Group, WarmupCosine, clip_factor, global_norm, missing_gradients};
use weaver_run::{Folder, Scalar, StepReport};
use weaver_splat::{AnyRasterizer, Renderer, WorkspacePool};

/// A training run: the model, its data, and its progress.
#[derive(Debug)]
pub struct Session<R: Recipe> {
    config: Config<R>,
    network: Arc<R::Network>,
    params: Params<f32>,
    optimizer: AdamW<f32>,
    ema: Ema<f32>,
    scenes: Vec<Scene>,
    layouts: Vec<Layout>,
    fresh: scenes::Endless,
    /// Remarks on the plan.
    remarks: Vec<String>,
    tape: Tape<f32>,
    /// Largest number of bytes of the tape in earlier stages.
    earlier_tape_bytes: usize,
    workspaces: WorkspacePool<f32>,
    /// Checksums of the inputs.
    sources: Sources,
    networks: ImageNetworks,
    /// The processes that share a step.
    ranks: Arc<dyn Ranks>,
    /// Steps done.
    step: usize,
    /// Measurement under way, if there is one.
    probe: Option<Probe>,
}

/// Position of a step: its stage, and the steps into it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Position {
    stage: usize,
    local: usize,
}

/// A step whose gradients are on the tape and whose update is still to come.
#[derive(Debug)]
pub struct PendingStep {
    position: Position,
    loss: f32,
    terms: Vec<(String, f32)>,
    gaussians_per_pixel: f32,
}

impl<R: Recipe> Session<R> {
    /// Starts a new run: loads its scenes and draws its weights.
    ///
    /// # Errors
    /// When the configuration is wrong, or the data cannot be read or has too few views.
    pub fn new(config: Config<R>) -> Result<Self, Error> {
        let mut session = Self::prepare(config)?;
        if let Some(path) = session.config.init.clone() {
            session.remarks.push(initial::weights(&path, &mut session.params)?);
            session.ema = new_average(&session.config, &session.params);
        }
        Ok(session)
    }

    /// A run before its first step, with random weights.
    fn prepare(config: Config<R>) -> Result<Self, Error> {
        config.check()?;
        let size = R::image_size(&config.model);
        check_memory::<R>(&config.model)?;
        let networks = evaluate::image_networks(config.network_files().map_err(Error::Input)?, size)?;
        let mut params = Params::new();
        let network = Arc::new(R::build(&config.model, &mut params, config.seed));
        frozen::check(&config.stages, &params)?;
        let scenes = scenes::load(&config.data, size)?;
        let sources = Sources::of(&config, &scenes)?;
        let mut remarks = Vec::new();
        for scene in &scenes {
            scene.check_training(config.data.most_context())?;
            remarks.extend(scenes::check_scale(scene, &config.data)?);
        }
        let optimizer = new_optimizer(&config, &params);
        let ema = new_average(&config, &params);
        let layouts = scenes.iter().map(Layout::of).collect();
        let fresh = scenes::Endless::new(&config.data, size, config.seed);
        let (tape, workspaces) = (Tape::new(), WorkspacePool::new());
        Ok(Self {
            config,
            network,
            params,
            optimizer,
            ema,
            scenes,
            layouts,
            fresh,
            remarks,
            tape,
            earlier_tape_bytes: 0,
            workspaces,
            sources,
            networks,
            ranks: Arc::new(Alone),
            step: 0,
            probe: None,
        })
    }

    /// Continues a run from a checkpoint.
    ///
    /// # Errors
    /// When the run began with another configuration ([`Config::difference`]) or other data, or the data cannot be
    /// read.
    pub fn resume(config: Config<R>, checkpoint: &Path) -> Result<Self, Error> {
        let checkpoint = Checkpoint::read(checkpoint)?;
        // Before anything is loaded.
        TrainingState::check_resumed(&checkpoint, &config)?;
        let mut session = Self::prepare(config)?;
        session.go_to(&checkpoint)?;
        Ok(session)
    }

    /// Steps done and steps planned.
    pub fn steps(&self) -> (usize, usize) {
        (self.step, self.config.steps())
    }

    /// The configuration.
    pub fn config(&self) -> &Config<R> {
        &self.config
    }

    /// The parameters as they are (not averaged).
    pub fn params(&self) -> &Params<f32> {
        &self.params
    }

    /// Draws by this rasterizer from now on, in training and in evaluation.
    pub fn draw_by(&mut self, rasterizer: AnyRasterizer<f32>) {
        self.workspaces = WorkspacePool::of(rasterizer);
    }

    /// Starts or stops measuring where the time of steps goes.
    pub fn set_profiling(&mut self, on: bool) {
        self.tape.set_profiling(on);
    }

    /// The time spent in each kind of op since profiling was started.
    pub fn op_times(&self) -> Vec<OpTime> {
        self.tape.op_times()
    }

    /// Bytes that the tape's values, gradients and scratch took at most.
    pub fn tape_bytes(&self) -> usize {
        self.tape.pool().allocated_bytes().max(self.earlier_tape_bytes)
    }

    /// Writes every op of one step of each stage, forward and backward, into a file in Chrome's trace format
    /// (chrome://tracing, Perfetto) as training passes that step.
    pub fn trace_to(&mut self, path: &Path) {
        self.probe = Some(Probe::trace(path));
    }

    /// Measures the resources of the run: runs some steps of each stage, writes a checkpoint and a picture into a
    /// folder that is not needed afterward, and evaluates one scene.
    ///
    /// # Errors
    /// As [`Session::train`].
    pub fn dry_run(mut self, folder: &Folder) -> Result<DryRun, Error> {
        let mut start = self.step;
        let (mut stages, mut first) = (Vec::new(), 0);
        for (index, stage) in self.config.stages.clone().into_iter().enumerate() {
            first += stage.steps;
            if start >= first {
                continue;
            }
            self.step = start;
            self.probe = Some(Probe::memory());
            let steps = DRY_RUN_STEPS.min(first - start);
            for step in 1..=steps {
                if step == steps {
                    R::enlarge(&mut self.config.stages[index], &self.config.model);
                }
                self.advance()?;
            }
            stages.extend(self.probe.take().and_then(Probe::into_stage));
            start = first;
        }
        folder.save(&self.tensors())?;
        self.sample(folder)?;
        self.evaluate_some(1)?;
        let [parameters, optimizer, average] = [1, 2, 1].map(|copies| copies * 4 * self.params.count());
        let batches = self.config.optimizer.accumulate;
        Ok(DryRun { parameters, optimizer, average, tape: self.tape_bytes(), batches, stages })
    }

    /// The stage of the next step; `None` when the run is finished.
    fn position(&self) -> Option<Position> {
        let mut local = self.step;
        for (stage, config) in self.config.stages.iter().enumerate() {
            if local < config.steps {
                return Some(Position { stage, local });
            }
            local -= config.steps;
        }
        None
    }

    /// One optimizer step: [`Session::gradients`], then [`Session::update`]; `None` when the run is finished.
    ///
    /// # Errors
    /// When a loss is not a number, or a parameter that should be trained received no gradient. The weights are then as
    /// before the step.
    pub fn advance(&mut self) -> Result<Option<StepReport>, Error> {
        let Some(pending) = self.gradients()? else { return Ok(None) };
        self.update(pending).map(Some)
    }

    /// The first part of a step: tuples, forward and backward pass, of one batch after the other. The gradients,
    /// averaged over the batches of all processes, are on the tape afterward; `None` when the run is finished.
    ///
    /// # Errors
    /// When a loss is not a number, or a parameter that should be trained received no gradient.
    pub fn gradients(&mut self) -> Result<Option<PendingStep>, Error> {
        let Some(position) = self.position() else { return Ok(None) };
        let Position { stage: index, local } = position;
        let stage = self.config.stages[index].clone();
        if local == 0 {
            // A stage starts from the weights as they are, with fresh moments and a fresh average.
            self.optimizer = new_optimizer(&self.config, &self.params);
            self.ema = new_average(&self.config, &self.params);
        }
        for (group, rate) in self.optimizer.groups.iter_mut().zip(R::group_rates(&stage)) {
            group.lr_scale = rate;
        }
        self.tape.reset();
        frozen::apply(&stage.frozen, &mut self.params);
        if local == 0 {
            // Its buffers have other sizes than in the stage before.
            self.earlier_tape_bytes = self.tape_bytes();
            self.tape.pool().trim::<f32>();
        }
        if let Some(probe) = &mut self.probe {
            probe.begin(&stage.name, stage.steps, local, &self.tape);
        }
        let pending = if self.config.optimizer.accumulate > 1 {
            self.averaged_batches(&stage, position)?
        } else {
            let Batch { loss, terms, gaussians_per_pixel } = self.batch(&stage, position, 0)?;
            PendingStep { position, loss, terms, gaussians_per_pixel }
        };
        if local == 0 {
            self.check_gradients(&stage)?;
        }
        Ok(Some(pending))
    }

    /// Tuples, forward and backward pass of one batch of the step, which leaves its gradients on the tape.
    fn batch(&mut self, stage: &StageConfig<R>, position: Position, number: usize) -> Result<Batch, Error> {
        let Position { stage: index, local } = position;
        self.tape.reset();
        // A single batch of a step draws by the step's number.
        let draw = self.step * self.config.optimizer.accumulate + number;
        let examples = self.examples(stage, draw)?;
        self.probe.iter_mut().for_each(|probe| probe.done("tuples"));
        let step = Step {
            config: &self.config,
            stage,
            local,
            networks: &self.networks,
            workspaces: &self.workspaces,
            stream: Stream::new(self.config.seed, draw as u64, "allocation"),
        };
        let cx = Context::new(&self.tape, &self.params).recomputing(stage.recompute);
        let terms = R::objective(cx, &self.network, &step, &examples)?;
        self.check_drawing()?;
        let values: Vec<(String, f32)> = terms.values().map(|(name, value)| (name.to_string(), value)).collect();
        if let Some((name, value)) = values.iter().find(|(_, v)| !v.is_finite()) {
            return Err(self.diverged(name, *value));
        }
        let total = terms.total().ok_or_else(|| Error::Input(format!("stage `{}` has no loss", stage.name)))?;
        let loss = total.item();
        if !loss.is_finite() {
            return Err(self.diverged("loss", loss));
        }
        if let Some(probe) = &mut self.probe {
            probe.done("forward");
            probe.held(&self.tape);
        }
        if !total.is_tracked() {
            let message = format!(
                "stages.{index}.frozen: expected a part to learn from the losses of stage `{}`, found none",
                stage.name
            );
            return Err(Error::Input(message));
        }
        total.backward();
        self.check_drawing()?;
        self.probe.iter_mut().for_each(|probe| probe.done("backward"));
        let gaussians_per_pixel = terms.gaussians_per_pixel;
        Ok(Batch { loss, terms: values, gaussians_per_pixel })
    }

    /// Lets `average` change the gradient of each parameter, in the order of the parameters, between
    /// [`Session::gradients`] and [`Session::update`]: a hook for trainers of one's own.
    pub fn reduce(&mut self, mut average: impl FnMut(&mut [f32])) {
        for id in self.params.ids() {
            if let Some(gradient) = self.tape.param_grad_mut(id) {
                average(gradient);
            }
        }
    }

    /// The last part of a step: clips the gradients and updates parameters and averages.
    ///
    /// # Errors
    /// When the gradients' norm is not a number; the weights are then as before the step. When rows that the model
    /// changes do not fit.
    pub fn update(&mut self, step: PendingStep) -> Result<StepReport, Error> {
        let PendingStep { position: Position { stage, local }, loss, terms, gaussians_per_pixel } = step;
        let norm = global_norm(&self.params, &self.tape);
        if !norm.is_finite() {
            return Err(self.diverged("gradient norm", norm as f32));
        }
        let stage = &self.config.stages[stage];
        let schedule = WarmupCosine { warmup: stage.warmup as u64, total: stage.steps as u64, floor: stage.floor };
        let rate = stage.rate * schedule.factor(local as u64);
        let clip = clip_factor(norm, self.config.optimizer.clip);
        self.optimizer.step_scaled(&mut self.params, &mut self.tape, rate, clip);
        self.ema.update(&self.params);
        if let Some(probe) = &mut self.probe {
            probe.done("optimizer");
            probe.end(&self.tape)?;
        }
        self.step += 1;
        let numbers =
            [("rate", rate as f32), ("gradient_norm", norm as f32), ("gaussians_per_pixel", gaussians_per_pixel)];
        let numbers = numbers.map(|(name, value)| Scalar::last(name, value.into()));
        let terms = terms.into_iter().map(|(name, value)| Scalar::last(format!("loss/{name}"), value.into()));
        Ok(StepReport {
            step: self.step,
            of: self.config.steps(),
            stage: stage.name.clone(),
            loss: loss.into(),
            scalars: terms.chain(numbers).collect(),
        })
    }

    /// The rasterizer's failure.
    fn check_drawing(&self) -> Result<(), Error> {
        self.workspaces.failure().map_or(Ok(()), |error| Err(weaver_inference::Error::from(error).into()))
    }

    fn diverged(&self, term: &str, value: f32) -> Error {
        Error::Numeric { step: self.step + 1, term: term.into(), value, last_good: None }
    }

    /// Every parameter that the stage can train must have a gradient; zero is a gradient.
    fn check_gradients(&self, stage: &StageConfig<R>) -> Result<(), Error> {
        let untrained = R::untrained(stage);
        let names: Vec<String> = missing_gradients(&self.params, &self.tape)
            .into_iter()
            .filter(|name| !untrained.iter().any(|module| name.starts_with(module)))
            .collect();
        if names.is_empty() { Ok(()) } else { Err(Error::MissingGradients { stage: stage.name.clone(), names }) }
    }

    fn options(&self) -> Options {
        Options {
            context_views: self.config.data.context_views,
            cameras: R::cameras(&self.config.evaluation),
            planted: self.config.data.looks.clone(),
            seed: self.config.seed,
            step: self.step,
            ..Options::default()
        }
    }

    /// The network with the averaged weights, for evaluation.
    fn predictor(&self) -> Result<Box<dyn Predictor>, Error> {
        let mut predictor = R::predictor(self.network.clone(), self.averaged(), &self.config)?;
        *predictor.renderer() = Renderer::new(self.workspaces.rasterizer().clone());
        Ok(predictor)
    }

    fn averaged(&self) -> Params<f32> {
        let mut params = self.params.clone();
        self.ema.clone().swap(&mut params);
        params
    }

    /// FNV-1a over the bits of all parameters: equal runs have equal checksums.
    pub fn checksum(&self) -> String {
        let values = self.params.iter().flat_map(|(_, param)| param.value().iter().copied());
        let hash = fnv1a(values.flat_map(f32::to_le_bytes));
        format!("{hash:016x}")
    }
}

/// Steps of each stage in a dry run: the first ones allocate and are slower, the last one is as large as steps get.
const DRY_RUN_STEPS: usize = 8;

/// Bytes of a parameter in training: its value, its gradient, two moments and its average.
const PARAMETER_BYTES: u64 = 5 * size_of::<f32>() as u64;

/// Refuses a network whose parameters do not fit into memory: an allocation that fails would end the process.
fn check_memory<R: Recipe>(model: &R::Model) -> Result<(), Error> {
    let mut declared = Params::new();
    R::declare(model, &mut declared);
    let numbers = declared.iter().map(|(_, param)| param.shape().len() as u64).fold(0, u64::saturating_add);
    let needed = numbers.saturating_mul(PARAMETER_BYTES);
    match weaver_io::available_memory() {
        Some(available) if available < needed => {
            Err(weaver_inference::Error::Memory { needed, available, source: Advice::SmallerNetwork }.into())
        }
        _ => Ok(()),
    }
}

fn new_optimizer<R: Recipe>(config: &Config<R>, params: &Params<f32>) -> AdamW<f32> {
    let o = &config.optimizer;
    let group = |params| Group { params, lr_scale: 1.0, weight_decay: o.weight_decay };
    AdamW::new(R::groups(params).into_iter().map(group).collect(), o.beta1, o.beta2, o.epsilon)
}

/// The average for evaluation; without a decay in the configuration it is 0, and the average equals the parameters.
fn new_average<R: Recipe>(config: &Config<R>, params: &Params<f32>) -> Ema<f32> {
    Ema::new(params, config.optimizer.ema.unwrap_or(0.0))
}
