//! The five stages of a step of HAC-lite.

use super::coding;
use super::model::{Model, SPREAD, Stage};
use super::start::{Groups, begin_context};
use crate::payload::broken;
use crate::recovery::targets;
use crate::{CompressionError, Schedule, Task, Training};
use std::collections::BTreeMap;
use weaver_autograd::Tape;
use weaver_io::safetensors::Tensors;
use weaver_kernels::random::Stream;
use weaver_losses::Photometric;
use weaver_nn::{AdamW, Group, Moments, Optimizer};
use weaver_pose::CameraVars;
use weaver_scene::{CameraRows, Gaussians, Photo};
use weaver_splat::{Rasterize, WorkspacePool};

/// Parts of 30,000 steps before noise, and before bits enter the loss.
const NOISE: f64 = 3000.0 / 30_000.0;
const BITS: f64 = 10_000.0 / 30_000.0;
/// Weight of the similarity in the loss.
const SIMILARITY: f64 = 0.2;
/// Rates of Scaffold-GS and HAC, by prefixes of names; and the factor on them at the end.
const RATES: [(&str, f64); 8] = [
    ("features", 0.0075 * SPREAD),
    ("scalings", 0.007),
    ("offsets", 0.01),
    ("masks", 0.01),
    ("table", 0.005),
    ("opacity.", 0.002),
    ("shape.", 0.004),
    ("color.", 0.008),
];
const CONTEXT: (&str, f64) = ("context.", 0.005);
const LEFT: f64 = 0.05;
/// Part of the steps in which rates rise, to keep the initial scene until moments are known.
const RISE: f64 = 0.02;
/// Key of the finished steps in a state.
const STEP: &str = "hac.step";

/// A scheduled task.
#[derive(Clone, Copy, Debug)]
enum Due {
    /// Fits the numbers of the given scene.
    Scene,
    /// Initializes their distribution.
    Context,
}

/// HAC-lite under way.
#[derive(Debug)]
pub(super) struct HacTraining<'a> {
    task: &'a Task<'a>,
    gaussians: Gaussians,
    groups: Groups,
    model: Model,
    optimizer: AdamW<f32>,
    schedule: Schedule<Due>,
    rate: f64,
    /// Finished steps, and all of them.
    steps: [usize; 2],
    photos: Vec<Photo>,
    tape: Tape<f32>,
    workspaces: WorkspacePool<f32>,
    photometric: Photometric<f32>,
}

impl<'a> HacTraining<'a> {
    pub fn new(task: &'a Task<'a>, gaussians: Gaussians, rate: f64, steps: usize) -> Result<Self, CompressionError> {
        let groups = Groups::new(&gaussians);
        let model = groups.model(gaussians.degree, task.seed);
        let group = |(name, rate): (&str, f64)| Group {
            params: model.params.iter().filter(|(_, it)| it.name().starts_with(name)).map(|(id, _)| id).collect(),
            lr_scale: rate,
            weight_decay: 0.0,
        };
        let optimizer = AdamW::new(RATES.into_iter().chain([CONTEXT]).map(group).collect(), 0.9, 0.999, 1e-15);
        let schedule = Schedule::new(vec![(0, 0, Due::Scene), (first(NOISE, steps), 1, Due::Context)]);
        let photos = if steps == 0 { Vec::new() } else { targets(task)? };
        Ok(Self {
            task,
            gaussians,
            groups,
            model,
            optimizer,
            schedule,
            rate,
            steps: [0, steps],
            photos,
            tape: Tape::new(),
            workspaces: WorkspacePool::new(),
            photometric: Photometric::new(),
        })
    }

    /// Runs the tasks due before a step.
    fn change(&mut self) -> Result<(), CompressionError> {
        for due in self.schedule.take_due(self.steps[0]) {
            match due {
                Due::Scene => self.groups.begin(&mut self.model, &self.gaussians, self.task)?,
                Due::Context => begin_context(&mut self.model),
            }
        }
        Ok(())
    }

    fn stage(&self) -> Stage {
        let [step, steps] = self.steps;
        Stage {
            noise: step >= first(NOISE, steps),
            rate: (step >= first(BITS, steps)).then_some(self.rate),
            stream: Stream::new(self.task.seed, step as u64, "compress.hac.noise"),
        }
    }

    /// The photo of this step: every photo once per epoch, in a random order that changes with the epoch.
    fn photo(&self) -> &Photo {
        let (step, count) = (self.steps[0], self.photos.len());
        let stream = Stream::new(self.task.seed, (step / count) as u64, "compress.hac.photos");
        &self.photos[stream.permutation(count)[step % count]]
    }
}

/// The first step of a part of the training.
fn first(part: f64, steps: usize) -> usize {
    (part * steps as f64) as usize
}

impl Training for HacTraining<'_> {
    fn steps(&self) -> [usize; 2] {
        self.steps
    }

    fn step(&mut self) -> Result<f64, CompressionError> {
        // Stage 1: tasks due before the step.
        self.change()?;
        // Stage 2: the picture of a camera.
        let (stage, photo, pictures) = (self.stage(), self.photo(), &self.task.pictures);
        let [height, width] = photo.size();
        let drawn = self.model.drawn(&self.tape, stage);
        let rows = CameraRows::new(&[photo.camera]);
        let camera = CameraVars {
            viewmats: self.tape.constant(&rows.viewmats, [1, 3, 4]),
            intrinsics: self.tape.constant(&rows.intrinsics, [1, 4]),
        };
        let background = self.tape.constant(&pictures.background, [3]);
        let rasterize = Rasterize::new(width, height, pictures.settings, &self.workspaces).without_depth();
        let image = rasterize.apply(&drawn.gaussians, &camera, background).image;
        if let Some(error) = self.workspaces.failure() {
            return Err(error.into());
        }
        // Stage 3: the loss. Masked pixels take the drawn color.
        let picture = image.to_vec();
        let mut target: Vec<f32> = photo.rgb.iter().map(|x| f32::from(*x) / 255.0).collect();
        for (pixel, _) in photo.mask.iter().flatten().enumerate().filter(|(_, counts)| !**counts) {
            target[3 * pixel..][..3].copy_from_slice(&picture[3 * pixel..][..3]);
        }
        let mut slopes = vec![0.0; picture.len()];
        let value = self.photometric.value_and_gradient(&picture, &target, [height, width], SIMILARITY, &mut slopes);
        let loss = value.loss + f64::from(drawn.penalty.item());
        if !loss.is_finite() {
            return Err(broken(format!("loss of step {}", self.steps[0]), "a number", loss));
        }
        let linear = (image * self.tape.constant(&slopes, image.shape())).sum();
        (linear.reshape(drawn.penalty.shape()) + drawn.penalty).backward();
        // Stage 4 is empty: anchors neither grow nor go. Stage 5: the optimizer.
        let [step, steps] = self.steps;
        let (done, rise) = (step as f64, RISE * steps as f64);
        let rate = LEFT.powf(done / steps as f64) * ((done + 1.0) / rise.max(1.0)).min(1.0);
        self.optimizer.step(&mut self.model.params, &mut self.tape, rate);
        self.tape.reset();
        self.steps[0] += 1;
        Ok(loss)
    }

    fn state(&self) -> Tensors {
        let mut state = Tensors::default();
        for (_, param) in self.model.params.iter() {
            state.insert(param.name(), param.shape().dims(), param.value().to_vec());
        }
        for (name, steps, moments) in self.optimizer.state(&self.model.params) {
            state.insert(format!("moment1.{name}"), &[moments.first.len()], moments.first.clone());
            state.insert(format!("moment2.{name}"), &[moments.second.len()], moments.second.clone());
            state.insert(format!("moment_steps.{name}"), &[1], vec![steps]);
        }
        state.insert(STEP, &[1], vec![self.steps[0] as u64]);
        state
    }

    fn restore(&mut self, state: &Tensors) -> Result<(), CompressionError> {
        let done = state.values::<u64>(STEP, &[1])?[0] as usize;
        if done > self.steps[1] {
            return Err(broken(STEP, format!("up to {} steps", self.steps[1]), done));
        }
        let mut moments = BTreeMap::new();
        for id in self.model.params.ids().collect::<Vec<_>>() {
            let (name, shape) = (self.model.params.get(id).name().to_string(), self.model.params.get(id).shape());
            self.model.params.value_mut(id).copy_from_slice(state.values::<f32>(&name, shape.dims())?);
            if state.get(&format!("moment_steps.{name}")).is_ok() {
                let steps = state.values::<u64>(&format!("moment_steps.{name}"), &[1])?[0];
                let moment = |k: usize| state.values::<f32>(&format!("moment{k}.{name}"), &[shape.len()]);
                let (first, second) = (moment(1)?.to_vec(), moment(2)?.to_vec());
                moments.insert(name, (steps, Moments { first, second }));
            }
        }
        let misfit = |error: weaver_nn::StateError| broken("optimizer", "the state of these parameters", error);
        self.optimizer.set_state(&self.model.params, moments).map_err(misfit)?;
        self.steps[0] = done;
        self.schedule.go_on(done);
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<Vec<u8>, CompressionError> {
        self.change()?;
        coding::write(&self.model, &self.groups)
    }
}
