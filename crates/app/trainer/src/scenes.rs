//! The scenes that a configuration names.

use crate::{DataConfig, Error, taught};
use std::path::PathBuf;
use weaver_data::capture::{self, CaptureOptions};
use weaver_data::{Layout, Scene};
use weaver_kernels::random::Stream;
use weaver_procedural::ProceduralOptions;

/// Loads the scenes of a run at the network's size (H, W): its captures, or the built-in procedural set.
///
/// # Errors
/// When a capture cannot be read.
pub fn load(data: &DataConfig, size: [usize; 2]) -> Result<Vec<Scene>, Error> {
    if data.folders.is_empty() && data.looks.as_ref().is_some_and(|looks| looks.moving_sun) {
        Ok(weaver_procedural::moving_sun_set(size[1], size[0]))
    } else if data.folders.is_empty() {
        Ok(weaver_procedural::default_training_set(size[1], size[0]))
    } else {
        load_captures(&data.folders, data, size)
    }
}

/// Loads captures at the network's size (H, W), with the scale, the masks and the teacher of `data`.
///
/// # Errors
/// When one cannot be read.
pub fn load_captures(folders: &[PathBuf], data: &DataConfig, [height, width]: [usize; 2]) -> Result<Vec<Scene>, Error> {
    let (scene_scale, masks) = (data.scene_scale, data.masks);
    let options = CaptureOptions { width, height, scene_scale, masks, ..CaptureOptions::default() };
    let load = |folder: &PathBuf| match &data.teacher {
        Some(teacher) if !capture::has_cameras(folder)? => taught::load(folder, teacher, data, [height, width]),
        _ => Ok(capture::load(folder, &options)?),
    };
    folders.iter().map(load).collect()
}

/// Checks that tuples of a scene have a scale, by the points that their context sees or by the scene's own scale;
/// returns a remark on photos that see no points.
///
/// # Errors
/// When no tuple that training could draw has one.
pub fn check_scale(scene: &Scene, data: &DataConfig) -> Result<Option<String>, Error> {
    let training = scene.training_views();
    let blind: Vec<usize> = training.iter().copied().filter(|&view| scene.visible[view].is_empty()).collect();
    if scene.scale.is_some() || blind.is_empty() {
        return Ok(None);
    }
    let tells = |target: usize| scene.nearest(target, &training, data.pool).iter().any(|view| !blind.contains(view));
    if blind.len() == training.len() || !training.iter().any(|&target| tells(target)) {
        let context = training[..data.context_views.min(training.len())].to_vec();
        return Err(weaver_data::Error::Scale { scene: scene.name.clone(), context, found: None }.into());
    }
    let mut names: Vec<&str> = blind.iter().take(LISTED).map(|&view| scene.views[view].name.as_str()).collect();
    if blind.len() > LISTED {
        names.push("...");
    }
    Ok(Some(format!(
        "warning: scene {}: {} of {} training photos see no points: {}; tuples of nothing but such photos tell no scale and are left \
         out, unless data.scene_scale does",
        scene.name,
        blind.len(),
        training.len(),
        names.join(", ")
    )))
}

/// Photos that a remark lists.
const LISTED: usize = 10;

/// Procedural scenes without end: some are kept, and at regular steps a fresh one takes the place of the oldest.
///
/// Which ones are kept is a function of the seed and the step alone, so that a run can go on from any step.
#[derive(Debug)]
pub struct Endless {
    every: Option<usize>,
    stream: Stream,
    options: ProceduralOptions,
    /// The number of each scene in the sequence of all.
    numbers: Vec<usize>,
    scenes: Vec<Scene>,
    layouts: Vec<Layout>,
}

/// Views of a fresh scene: enough for a tuple with some choice.
pub(crate) const FRESH_VIEWS: usize = 8;
/// Scenes that are kept: drawing one costs as much as some of a step, so that each serves more than one step.
const KEPT: usize = 16;

impl Endless {
    /// The endless scenes of a configuration; none without `data.endless` or with captures.
    pub fn new(data: &DataConfig, [height, width]: [usize; 2], seed: u64) -> Self {
        let every = data.endless.filter(|_| data.folders.is_empty());
        let options = ProceduralOptions { width, height, views: FRESH_VIEWS };
        Self {
            every,
            stream: Stream::new(seed, 0, "scenes"),
            options,
            numbers: Vec::new(),
            scenes: Vec::new(),
            layouts: Vec::new(),
        }
    }

    /// True if there are any.
    pub fn is_some(&self) -> bool {
        self.every.is_some()
    }

    /// The scenes of a step and their layouts; `None` when the set is fixed.
    pub fn scenes(&mut self, step: usize) -> Option<(&[Scene], &[Layout])> {
        let last = step / self.every? + KEPT - 1;
        for place in 0..KEPT {
            let number = last - (last - place) % KEPT;
            if self.numbers.get(place) == Some(&number) {
                continue;
            }
            let fresh = self.fresh(number);
            let layout = Layout::of(&fresh);
            if place < self.scenes.len() {
                (self.numbers[place], self.scenes[place], self.layouts[place]) = (number, fresh, layout);
            } else {
                self.numbers.push(number);
                self.scenes.push(fresh);
                self.layouts.push(layout);
            }
        }
        Some((&self.scenes, &self.layouts))
    }

    fn fresh(&self, number: usize) -> Scene {
        let mut scene = weaver_procedural::varied_scene(self.stream.bits(number as u64), &self.options);
        scene.views.iter_mut().for_each(|view| view.held_out = false);
        scene
    }
}
