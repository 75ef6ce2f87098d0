//! Checks of a configuration before anything is loaded or written. The ranges of single numbers are beside the keys;
//! conditions on several keys are here.

use super::Config;
use crate::evaluate::LEAST_SIDE;
use crate::losses::ImageLosses;
use crate::scenes::FRESH_VIEWS;
use crate::{Error, LossSection, Recipe, SamplerKind};
use std::path::Path;
use weaver_run::settings::Error as Wrong;

impl<R: Recipe> Config<R> {
    /// Checks every number and the conditions on several keys, for configurations that were made in code.
    ///
    /// # Errors
    /// The first wrong key, with its range or the expected value, and the value found.
    pub fn check(&self) -> Result<(), Error> {
        weaver_run::settings::check(self, "configuration")?;
        let checked = self.check_combinations().and_then(|()| self.check_folders());
        Ok(checked.map_err(|message| Wrong::invalid("configuration", message))?)
    }

    /// Checks settings that are of use with captures alone. They may be named after all else was set.
    fn check_folders(&self) -> Result<(), String> {
        let d = &self.data;
        if d.teacher.is_some() && d.folders.is_empty() {
            return Err("data.teacher: expected folders of photos in data.folders beside it, found none".into());
        }
        if d.looks.as_ref().is_some_and(|looks| looks.moving_sun) && !d.folders.is_empty() {
            return Err(
                "data.looks.moving_sun: expected no data.folders beside it: photos have the sun that they have".into(),
            );
        }
        if d.masks && d.folders.is_empty() {
            return Err(
                "data.masks: expected data.folders beside it, found none: procedural scenes have no masks".into()
            );
        }
        Ok(())
    }

    pub(super) fn check_combinations(&self) -> Result<(), String> {
        if self.architecture != R::ARCHITECTURE {
            return Err(format!("architecture: expected `{}`, found `{}`", R::ARCHITECTURE, self.architecture));
        }
        if self.stages.is_empty() {
            return Err("stages: expected at least one".into());
        }
        let d = &self.data;
        if d.most_context() < d.context_views {
            let (least, found) = (d.context_views, d.most_context());
            return Err(format!(
                "data.most_context_views: expected at least data.context_views, {least}, found {found}"
            ));
        }
        if d.sampler == SamplerKind::Nearest && d.pool < d.most_context() {
            let (most, key) = match d.most_context_views {
                Some(most) => (most, "most_context_views"),
                None => (d.context_views, "context_views"),
            };
            return Err(format!("data.pool: expected at least data.{key}, {most}, found {}", d.pool));
        }
        if d.endless.is_some() && d.most_context() >= FRESH_VIEWS {
            let (most, found) = (FRESH_VIEWS - 1, d.most_context());
            return Err(format!(
                "data.endless: expected at most {most} context views of scenes with {FRESH_VIEWS}, found {found}"
            ));
        }
        if d.looks.as_ref().is_some_and(|looks| looks.moving_sun) && d.endless.is_some() {
            return Err(
                "data.looks.moving_sun: expected no data.endless beside it, whose scenes have suns of their own".into(),
            );
        }
        if d.endless.is_some() && !d.folders.is_empty() {
            return Err("data.endless: expected none beside data.folders, which it does not apply to; \
                        `--set data.endless=none` trains on the captures"
                .into());
        }
        for (i, stage) in self.stages.iter().enumerate() {
            if R::tuples(stage) == 0 {
                return Err(format!("stages.{i}.tuples: expected a step to have tuples, found none"));
            }
        }
        for (i, stage) in self.stages.iter().enumerate() {
            if let Some((table, image)) = stage.losses.image() {
                let separator = if table.is_empty() { "" } else { "." };
                image.check(&format!("stages.{i}.losses{separator}{table}"))?;
            }
        }
        // Sizes that the model does not allow are its own to explain.
        R::check(self)?;
        let [height, width] = R::image_size(&self.model);
        if height.min(width) < LEAST_SIDE {
            return Err(format!(
                "model: expected images of at least {LEAST_SIDE} x {LEAST_SIDE} pixels, the window of SSIM, found {width} x {height}"
            ));
        }
        self.network_files().map(|_| ())
    }

    /// The files of the networks that images are compared by, with their keys, where some stage needs them: one of each
    /// for all stages.
    pub(crate) fn network_files(&self) -> Result<[(&'static str, Option<&Path>); 2], String> {
        let mut found = ImageLosses::default().files().map(|(key, _)| (key, None::<(usize, &Path)>));
        for (i, stage) in self.stages.iter().enumerate() {
            let Some((_, image)) = stage.losses.image() else { continue };
            for ((_, found), (key, file)) in found.iter_mut().zip(image.files()) {
                let Some(file) = file else { continue };
                let (first, other) = *found.get_or_insert((i, file));
                if other != file {
                    let (other, file) = (other.display(), file.display());
                    return Err(format!(
                        "stages.{i}: {key}: expected the file of stages.{first}, {other}, found {file}"
                    ));
                }
            }
        }
        Ok(found.map(|(key, found)| (key, found.map(|(_, file)| file))))
    }
}
