//! Loads the scenes that a configuration names.

use crate::{Config, Error};
use std::path::PathBuf;
use weaver_data::capture::{self, CaptureOptions};
use weaver_data::procedural::ProceduralOptions;
use weaver_data::{Scene, procedural};
use weaver_kernels::random::Stream;

/// The scenes of a run: its captures, or the built-in procedural set.
///
/// # Errors
/// When a capture cannot be read.
pub fn load(config: &Config) -> Result<Vec<Scene>, Error> {
    if config.data.folders.is_empty() {
        Ok(procedural::default_training_set(config.model.width, config.model.height))
    } else {
        load_captures(&config.data.folders, config)
    }
}

/// Loads captures at the network's size.
///
/// # Errors
/// When one cannot be read.
pub fn load_captures(folders: &[PathBuf], config: &Config) -> Result<Vec<Scene>, Error> {
    let options = CaptureOptions {
        width: config.model.width,
        height: config.model.height,
        scene_scale: (config.data.scene_scale > 0.0).then_some(config.data.scene_scale),
        ..CaptureOptions::default()
    };
    folders.iter().map(|folder| Ok(capture::load(folder, &options)?)).collect()
}

/// Fresh procedural scenes, block after block of steps.
#[derive(Debug)]
pub struct Endless {
    every: usize,
    seed: u64,
    options: ProceduralOptions,
    block: Option<usize>,
    scenes: Vec<Scene>,
}

/// Views of a fresh scene: enough for a tuple with some choice.
const FRESH_VIEWS: usize = 8;

impl Endless {
    /// What the configuration asks for; nothing with `data.endless = 0` or with captures.
    pub fn new(config: &Config) -> Self {
        let every = if config.data.folders.is_empty() { config.data.endless } else { 0 };
        let options = ProceduralOptions { width: config.model.width, height: config.model.height, views: FRESH_VIEWS };
        Self { every, seed: config.seed, options, block: None, scenes: Vec::new() }
    }

    /// The scenes of a step, `count` of them; `None` when the set is fixed.
    pub fn scenes(&mut self, step: usize, count: usize) -> Option<&[Scene]> {
        let block = step.checked_div(self.every)?;
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
