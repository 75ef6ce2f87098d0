//! The inputs of a run, recognized by their content.

use crate::{Config, Error, Recipe};
use std::collections::BTreeMap;
use weaver_data::Scene;
use weaver_inference::Checkpoint;
use weaver_io::Checksum;
use weaver_io::safetensors::Tensors;

/// The entry of a checkpoint's metadata.
pub(crate) const ENTRY: &str = "sources";

/// Checksums of the inputs of a run, by their keys in the configuration.
///
/// The content of the inputs decides the bits, not their place: captures as they were loaded (photos at the network's
/// size, cameras, depth, points), and the tensors of networks that compare images. Folders may have been moved and
/// renamed; their content may not have changed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sources(BTreeMap<String, String>);

impl Sources {
    /// The checksums for a configuration, with its scenes as they were loaded.
    pub(crate) fn of<R: Recipe>(config: &Config<R>, scenes: &[Scene]) -> Result<Self, Error> {
        let mut all = BTreeMap::new();
        if !config.data.folders.is_empty() {
            let sums = scenes.iter().enumerate().map(|(i, scene)| (format!("data.folders.{i}"), of_scene(scene)));
            all.extend(sums);
        }
        for (key, file) in config.network_files().map_err(Error::Input)? {
            let Some(file) = file else { continue };
            let mut sum = Checksum::default();
            for (name, tensor) in &Tensors::read(file)?.tensors {
                sum.bytes(name.as_bytes());
                sum.floats(&tensor.data.widened().unwrap_or_default());
            }
            all.insert(key.into(), sum.to_string());
        }
        Ok(Self(all))
    }

    /// The checksums in a checkpoint, if it has them.
    pub(crate) fn of_checkpoint(checkpoint: &Checkpoint) -> Result<Option<Self>, Error> {
        let Some(text) = checkpoint.tensors().metadata.get(ENTRY) else { return Ok(None) };
        let all = serde_json::from_str(text).map_err(|e| checkpoint.wrong(format!("metadata {ENTRY}: {e}")))?;
        Ok(Some(Self(all)))
    }

    /// The indices of scenes, loaded from the same folders, whose content has changed.
    pub(crate) fn changed(&self, scenes: &[Scene]) -> impl Iterator<Item = usize> {
        let began = move |i: usize| self.0.get(&format!("data.folders.{i}"));
        scenes
            .iter()
            .enumerate()
            .filter(move |(i, scene)| began(*i).is_some_and(|sum| *sum != of_scene(scene)))
            .map(|(i, _)| i)
    }

    /// The checksums by key.
    pub(crate) fn entries(&self) -> impl Iterator<Item = (&str, &str)> {
        self.0.iter().map(|(key, sum)| (key.as_str(), sum.as_str()))
    }

    /// The form of the checksums in a checkpoint.
    pub(crate) fn to_json(&self) -> String {
        serde_json::to_string(&self.0).expect("text by text is plain data")
    }

    /// Checks that a resumed run has read the same inputs as at its start. Checkpoints without checksums pass.
    ///
    /// # Errors
    /// When inputs differ; names the first key that does.
    pub(crate) fn check<R: Recipe>(&self, checkpoint: &Checkpoint, config: &Config<R>) -> Result<(), Error> {
        let Some(Self(began)) = Self::of_checkpoint(checkpoint)? else { return Ok(()) };
        let Some(key) = began.keys().chain(self.0.keys()).find(|key| began.get(*key) != self.0.get(*key)) else {
            return Ok(());
        };
        let number = key.strip_prefix("data.folders.").and_then(|number| number.parse::<usize>().ok());
        let (what, path) = match number {
            Some(i) => ("photos, cameras and points", config.data.folders.get(i).cloned()),
            None => {
                let files = config.network_files().map_err(Error::Input)?;
                ("weights", files.iter().find(|(name, _)| name == key).and_then(|(_, file)| file.map(Into::into)))
            }
        };
        let found = match (path, began.contains_key(key)) {
            (Some(path), true) => format!("others in {}", path.display()),
            (Some(path), false) => format!("{}, which it began without", path.display()),
            (None, _) => "nothing".into(),
        };
        let message =
            format!("{key}: expected the {what} that the run began with, wherever they are now, found {found}");
        Err(checkpoint.wrong(message).into())
    }
}

fn of_scene(scene: &Scene) -> String {
    let mut sum = Checksum::default();
    for view in &scene.views {
        sum.word(view.image.width as u64);
        sum.floats(&view.image.pixels);
        let camera = &view.camera;
        let k = &camera.intrinsics;
        let pose = camera.pose.rotation.to_cols_array().into_iter().chain(camera.pose.translation.to_array());
        pose.chain([k.fx, k.fy, k.cx, k.cy]).for_each(|x| sum.word(x.to_bits()));
        sum.word(u64::from(view.held_out));
        view.inside.iter().flatten().for_each(|inside| sum.word(u64::from(*inside)));
        sum.floats(view.depth.as_deref().unwrap_or_default());
    }
    scene.points.iter().flat_map(|p| p.to_array()).for_each(|x| sum.word(x.to_bits()));
    for visible in &scene.visible {
        sum.word(visible.len() as u64);
        visible.iter().for_each(|point| sum.word(u64::from(*point)));
    }
    sum.to_string()
}
