//! The training loop.

use crate::batch::Batch;
use crate::evaluate;
use crate::evaluation::Summary;
use crate::objective::Objective;
use crate::observe::{MetricsLog, Observer, StepReport, TensorBoard, write_report};
use crate::probe::{Probe, Rehearsal};
use crate::{Checkpoint, Config, Error, RunFolder, StageConfig, samples, scenes};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use weaver_autograd::{OpTime, Params, Tape};
use weaver_data::{Scene, Tuple, training_tuple};
use weaver_kernels::random::Stream;
use weaver_losses::Lpips;
use weaver_model::SplatWeaver;
use weaver_nn::{AdamW, Context, Ema, Group, WarmupCosine, clip_factor, global_norm, missing_gradients};
use weaver_router::{Allocation, TrainingMix};
use weaver_splat::WorkspacePool;

/// A training run: the model, its data, and how far it is.
#[derive(Debug)]
pub struct Session {
    config: Config,
    model: SplatWeaver,
    params: Params<f32>,
    optimizer: AdamW<f32>,
    ema: Ema<f32>,
    scenes: Vec<Scene>,
    fresh: scenes::Endless,
    tape: Tape<f32>,
    /// The most that the tape took in stages before this one.
    earlier_tape_bytes: usize,
    workspaces: WorkspacePool<f32>,
    lpips: Option<Lpips<f32>>,
    /// Steps done.
    step: usize,
    /// What is being measured, if anything is.
    probe: Option<Probe>,
}

/// Where a step stands: its stage, and how far into it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Position {
    stage: usize,
    local: usize,
}

impl Session {
    /// A new run: loads its scenes and draws its weights.
    ///
    /// # Errors
    /// When the data cannot be read or has too few views.
    pub fn new(config: Config) -> Result<Self, Error> {
        let scenes = scenes::load(&config)?;
        for (index, scene) in scenes.iter().enumerate() {
            scene.check_training(config.data.context_views)?;
            if scene.points.is_empty() {
                // Its scale must be given; better said before anything is written.
                let context = scene.training_views()[..config.data.context_views].to_vec();
                scene.normalized(&Tuple { scene: index, context, targets: Vec::new() })?;
            }
        }
        let mut params = Params::new();
        let model = SplatWeaver::new(config.model.clone(), &mut params, config.seed);
        let optimizer = new_optimizer(&config, &params);
        let ema = Ema::new(&params, config.optimizer.ema);
        let path = config.stages.iter().map(|s| &s.losses).find(|l| l.lpips > 0.0).map(|l| l.lpips_weights.clone());
        let lpips = path.map(|path| evaluate::load_lpips(&path)).transpose()?;
        let fresh = scenes::Endless::new(&config);
        let (tape, workspaces) = (Tape::new(), WorkspacePool::new());
        Ok(Self {
            config,
            model,
            params,
            optimizer,
            ema,
            scenes,
            fresh,
            tape,
            earlier_tape_bytes: 0,
            workspaces,
            lpips,
            step: 0,
            probe: None,
        })
    }

    /// Continues from a checkpoint.
    ///
    /// # Errors
    /// When it does not fit the configuration, or the data cannot be read.
    pub fn resume(config: Config, checkpoint: &Path) -> Result<Self, Error> {
        let checkpoint = Checkpoint::read(checkpoint, &config)?;
        let mut session = Self::new(config)?;
        checkpoint.restore(&mut session.params, &mut session.optimizer, &mut session.ema)?;
        session.step = checkpoint.step;
        Ok(session)
    }

    /// Steps done and steps planned.
    pub fn steps(&self) -> (usize, usize) {
        (self.step, self.config.steps())
    }

    /// The configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The parameters as they are (not averaged).
    pub fn params(&self) -> &Params<f32> {
        &self.params
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

    /// Does a little of all that a run does, to say what it will take: some steps of each stage, a checkpoint and a picture in a
    /// folder that is not needed afterward, the evaluation of a scene.
    ///
    /// # Errors
    /// As [`Session::train`].
    pub fn rehearse(mut self, folder: &RunFolder) -> Result<Rehearsal, Error> {
        let mut start = self.step;
        let (mut stages, mut first) = (Vec::new(), 0);
        for stage in self.config.stages.clone() {
            first += stage.steps;
            if start >= first {
                continue;
            }
            self.step = start;
            self.probe = Some(Probe::memory());
            for _ in 0..REHEARSED.min(first - start) {
                self.advance()?;
            }
            stages.extend(self.probe.take().and_then(Probe::into_stage));
            start = first;
        }
        self.save(&folder.checkpoint_path())?;
        self.sample(folder)?;
        self.evaluate_some(1)?;
        let [parameters, optimizer, average] = [1, 2, 1].map(|copies| copies * 4 * self.params.count());
        Ok(Rehearsal { parameters, optimizer, average, tape: self.tape_bytes(), stages })
    }

    /// What is about to happen, for people.
    pub fn plan(&self) -> String {
        let views: usize = self.scenes.iter().map(|s| s.views.len()).sum();
        let m = &self.config.model;
        let mut text = format!(
            "preset {}, {} x {}, {:.2} M parameters; {} scenes, {views} views\n",
            self.config.preset,
            m.width,
            m.height,
            self.params.count() as f64 / 1e6,
            self.scenes.len()
        );
        for stage in &self.config.stages {
            let untrained = untrained_modules(stage);
            let note =
                if untrained.is_empty() { String::new() } else { format!("; untrained: {}", untrained.join(", ")) };
            text.push_str(&format!(
                "stage {}: {} steps of {} rendered and {} posed tuples{note}\n",
                stage.name, stage.steps, stage.tuples, stage.pose_tuples
            ));
        }
        text
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

    /// One optimizer step; `None` when the run is finished.
    ///
    /// # Errors
    /// When a loss is not a number, or a parameter that should be trained received no gradient. The weights are then
    /// those of the step before.
    pub fn advance(&mut self) -> Result<Option<StepReport>, Error> {
        let Some(Position { stage: index, local }) = self.position() else { return Ok(None) };
        let stage = self.config.stages[index].clone();
        if local == 0 {
            // A stage starts from the weights as they are, with fresh moments and a fresh average.
            self.optimizer = new_optimizer(&self.config, &self.params);
            self.ema = Ema::new(&self.params, self.config.optimizer.ema);
        }
        self.optimizer.groups[BACKBONE].lr_scale = stage.backbone_rate;
        let seed = self.config.seed;
        self.tape.reset();
        if local == 0 {
            // Its buffers have other sizes than those of the stage before.
            self.earlier_tape_bytes = self.tape_bytes();
            self.tape.pool().trim::<f32>();
        }
        if let Some(probe) = &mut self.probe {
            probe.begin(&stage, local, &self.tape);
        }
        let batches = self.batches(&stage)?;
        self.probe.iter_mut().for_each(|probe| probe.done("tuples"));
        let allocation = self.allocation(&stage)?;
        let objective = Objective {
            stage: &stage,
            ranking: (local as f64) < stage.losses.rank_until * stage.steps as f64,
            allocation: &*allocation,
            lpips: self.lpips.as_ref(),
            workspaces: &self.workspaces,
            stream: Stream::new(seed, self.step as u64, "allocation"),
        };
        let cx = Context::new(&self.tape, &self.params);
        let terms = objective.terms(cx, &self.model, &batches);
        let diverged =
            |term: &str, value: f32| Error::Diverged { step: self.step + 1, term: term.into(), value, last_good: None };
        let values: Vec<(String, f32)> = terms.values().map(|(name, value)| (name.to_string(), value)).collect();
        if let Some((name, value)) = values.iter().find(|(_, v)| !v.is_finite()) {
            return Err(diverged(name, *value));
        }
        let total = terms.total().ok_or_else(|| Error::Usage(format!("stage `{}` has no loss", stage.name)))?;
        let loss = total.item();
        if !loss.is_finite() {
            return Err(diverged("loss", loss));
        }
        if let Some(probe) = &mut self.probe {
            probe.done("forward");
            probe.held(&self.tape);
        }
        total.backward();
        self.probe.iter_mut().for_each(|probe| probe.done("backward"));
        if local == 0 {
            self.check_gradients(&stage)?;
        }
        let norm = global_norm(&self.params, &self.tape);
        if !norm.is_finite() {
            return Err(diverged("gradient norm", norm as f32));
        }
        let gaussians_per_pixel = terms.gaussians_per_pixel;
        drop(terms);
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
        Ok(Some(StepReport {
            step: self.step,
            stage: stage.name,
            loss,
            terms: values,
            rate: rate as f32,
            gradient_norm: norm as f32,
            gaussians_per_pixel,
            seconds: 0.0,
        }))
    }

    /// The step's tuples: those to be rendered first.
    fn batches(&mut self, stage: &StageConfig) -> Result<Vec<Batch>, Error> {
        let d = &self.config.data;
        let count = stage.tuples + stage.pose_tuples;
        let scenes = match self.fresh.scenes(self.step, count) {
            Some(fresh) => fresh,
            None => &self.scenes,
        };
        let stream = Stream::new(self.config.seed, self.step as u64, "tuples");
        (0..count as u64)
            .map(|i| {
                let tuple = training_tuple(scenes, stream, i, d.pool, d.context_views, d.target_views);
                Batch::new(&scenes[tuple.scene], tuple)
            })
            .collect()
    }

    fn allocation(&self, stage: &StageConfig) -> Result<Box<dyn Allocation<f32>>, Error> {
        if stage.allocation == "mix" {
            return Ok(Box::new(TrainingMix::default()));
        }
        let experts = self.config.model.gaussians.experts + 1;
        evaluate::parse_allocation(&stage.allocation)?
            .allocation(stage.budget, experts)
            .map_err(|e| Error::Usage(e.to_string()))
    }

    /// Every parameter that the stage can train must have a gradient; zero is a gradient.
    fn check_gradients(&self, stage: &StageConfig) -> Result<(), Error> {
        let untrained = untrained_modules(stage);
        let names: Vec<String> = missing_gradients(&self.params, &self.tape)
            .into_iter()
            .filter(|name| !untrained.iter().any(|module| name.starts_with(module)))
            .collect();
        if names.is_empty() { Ok(()) } else { Err(Error::MissingGradients { stage: stage.name.clone(), names }) }
    }

    /// Trains to the end, or until `stop` is set, and writes everything that belongs into a run folder.
    ///
    /// # Errors
    /// When a loss diverges or something cannot be written. A checkpoint of an earlier step is never lost.
    pub fn train(
        &mut self,
        folder: &RunFolder,
        observer: &mut dyn Observer,
        stop: &AtomicBool,
    ) -> Result<Summary, Error> {
        let started = Instant::now();
        let o = self.config.output.clone();
        let mut log = MetricsLog::open(&folder.metrics_path(), self.step, o.log_every)?;
        let mut board = TensorBoard::create(&folder.events_path(), o.log_every)?;
        let checkpoint = folder.checkpoint_path();
        if !checkpoint.exists() {
            self.save(&checkpoint)?;
        }
        let mut saved = self.step;
        while !stop.load(Ordering::Relaxed) {
            let report = match self.advance() {
                Ok(Some(report)) => report,
                Ok(None) => break,
                Err(Error::Diverged { step, term, value, .. }) => {
                    return Err(Error::Diverged { step, term, value, last_good: Some(checkpoint) });
                }
                Err(error) => return Err(error),
            };
            let report = StepReport { seconds: started.elapsed().as_secs_f64(), ..report };
            log.step(&report)?;
            board.step(&report)?;
            observer.step(&report)?;
            if self.step.is_multiple_of(o.checkpoint_every.max(1)) {
                self.save(&checkpoint)?;
                saved = self.step;
            }
            if self.step.is_multiple_of(o.sample_every.max(1)) {
                self.sample(folder)?;
            }
        }
        if saved != self.step {
            self.save(&checkpoint)?;
        }
        let finished = self.position().is_none();
        if finished {
            self.sample(folder)?;
        }
        let evaluation = if finished { Some(self.evaluate()?) } else { None };
        let summary = Summary {
            preset: self.config.preset.clone(),
            seed: self.config.seed,
            steps: self.step,
            planned: self.config.steps(),
            parameters: self.params.count(),
            seconds: started.elapsed().as_secs_f64(),
            checksum: self.checksum(),
            evaluation,
        };
        let json = serde_json::to_string_pretty(&summary).expect("a summary is plain data");
        weaver_io::write_text(folder.summary_path(), &json)?;
        write_report(folder, &summary)?;
        Ok(summary)
    }

    /// Writes a checkpoint.
    ///
    /// # Errors
    /// When it cannot be written; an earlier one is then left as it was.
    pub fn save(&self, path: &Path) -> Result<(), Error> {
        Checkpoint::write(path, &self.config, self.step, &self.params, &self.optimizer, &self.ema)
    }

    fn sample(&self, folder: &RunFolder) -> Result<(), Error> {
        let params = self.averaged();
        samples::write(&self.model, &params, &self.config, &self.scenes, &folder.sample_path(self.step))
    }

    fn evaluate(&self) -> Result<crate::Evaluation, Error> {
        self.evaluate_some(usize::MAX)
    }

    /// Evaluates at most so many scenes.
    fn evaluate_some(&self, most: usize) -> Result<crate::Evaluation, Error> {
        let params = self.averaged();
        let mut predictor = crate::Predictor::new(&self.model, &params);
        let with_held_out = self.scenes.iter().filter(|s| !s.held_out_views().is_empty());
        let held_out: Vec<&Scene> = with_held_out.take(most).collect();
        let options = evaluate::Options::default();
        evaluate::scenes_with(&mut predictor, &self.config, &held_out, &options, None, self.step, &mut |_, _| {})
    }

    /// The averaged weights, which are what is evaluated.
    fn averaged(&self) -> Params<f32> {
        let mut params = self.params.clone();
        self.ema.clone().swap(&mut params);
        params
    }

    /// FNV-1a over the bits of all parameters: equal runs have equal checksums.
    pub fn checksum(&self) -> String {
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        for (_, param) in self.params.iter() {
            for byte in param.value().iter().flat_map(|x| x.to_le_bytes()) {
                hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
            }
        }
        format!("{hash:016x}")
    }
}

/// Steps of each stage that a rehearsal runs: random budgets differ, and so does the memory.
const REHEARSED: usize = 8;

/// The optimizer's group of the backbone and the camera head; the other one is of the dense heads and everything after
/// them, which learn at the full rate.
const BACKBONE: usize = 0;

fn new_optimizer(config: &Config, params: &Params<f32>) -> AdamW<f32> {
    let o = &config.optimizer;
    let is_dense = |name: &str| name.starts_with("depth_head.") || name.starts_with("gaussian_param_head.");
    let group = |dense: bool| Group {
        params: params.iter().filter(|(_, p)| is_dense(p.name()) == dense).map(|(id, _)| id).collect(),
        lr_scale: 1.0,
        weight_decay: o.weight_decay,
    };
    AdamW::new(vec![group(false), group(true)], o.beta1, o.beta2, o.epsilon)
}

/// Modules that a stage has no loss for; they stay as they are.
fn untrained_modules(stage: &StageConfig) -> Vec<&'static str> {
    if stage.tuples == 0 {
        return vec!["depth_head", "gaussian_param_head"];
    }
    let l = &stage.losses;
    let routed =
        stage.allocation == "sampled" || stage.allocation == "argmax" || l.rank > 0.0 || l.error_regression > 0.0;
    if routed {
        Vec::new()
    } else {
        vec![
            "gaussian_param_head.gs_moe.gating",
            "gaussian_param_head.wave_merger1",
            "gaussian_param_head.wave_merger2",
        ]
    }
}
