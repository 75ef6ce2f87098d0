//! The scenes that a configuration names.

use crate::{DataConfig, Error};
use std::path::PathBuf;
use weaver_data::capture::{self, CaptureOptions};
use weaver_data::procedural::ProceduralOptions;
use weaver_data::{Scene, procedural};
use weaver_kernels::random::Stream;

/// Loads the scenes of a run at the network's size (H, W): its captures, or the built-in procedural set.
///
/// # Errors
/// When a capture cannot be read.
pub fn load(data: &DataConfig, size: [usize; 2]) -> Result<Vec<Scene>, Error> {
    if data.folders.is_empty() {
        Ok(procedural::default_training_set(size[1], size[0]))
    } else {
        load_captures(&data.folders, data.scene_scale, size)
    }
}

/// Loads captures at the network's size (H, W); `scene_scale` as in [`DataConfig::scene_scale`].
///
/// # Errors
/// When one cannot be read.
pub fn load_captures(
    folders: &[PathBuf],
    scene_scale: Option<f64>,
    [height, width]: [usize; 2],
) -> Result<Vec<Scene>, Error> {
    let options = CaptureOptions { width, height, scene_scale, ..CaptureOptions::default() };
    folders.iter().map(|folder| Ok(capture::load(folder, &options)?)).collect()
}

/// Fresh procedural scenes, block after block of steps.
#[derive(Debug)]
pub struct Endless {
    every: Option<usize>,
    seed: u64,
    options: ProceduralOptions,
    block: Option<usize>,
    scenes: Vec<Scene>,
}

/// Views of a fresh scene: enough for a tuple with some choice.
const FRESH_VIEWS: usize = 8;

impl Endless {
    /// The scenes that the configuration asks for; none without `data.endless` or with captures.
    pub fn new(data: &DataConfig, [height, width]: [usize; 2], seed: u64) -> Self {
        let every = data.endless.filter(|_| data.folders.is_empty());
        let options = ProceduralOptions { width, height, views: FRESH_VIEWS };
        Self { every, seed, options, block: None, scenes: Vec::new() }
    }

    /// The scenes of a step, `count` of them; `None` when the set is fixed.
    pub fn scenes(&mut self, step: usize, count: usize) -> Option<&[Scene]> {
        let block = step / self.every?;
        if self.block != Some(block) || self.scenes.len() != count {
            let seeds = Stream::new(self.seed, block as u64, "scenes");
            self.scenes = (0..count as u64)
                .map(|i| {
                    let mut scene = procedural::scene(seeds.bits(i), &self.options);
                    scene.views.iter_mut().for_each(|view| view.held_out = false);
                    scene
                })
                .collect();
            self.block = Some(block);
        }
        Some(&self.scenes)
    }
}
