//! Scenes of any origin without what no photo needs.

use crate::{Error, Outcome};
use std::path::Path;
use weaver_data::posed::{self, PosedOptions};
use weaver_fit::{Cleaned, CleaningRules, Fit, FitSettings};
use weaver_io::{Observe, Part, Stage};
use weaver_scene::{Gaussians, Photo};
use weaver_splat::RasterSettings;

/// Name of the stage.
const CLEAN: &str = "clean";
/// Longest side of the photos, pixels.
const LONG_SIDE: usize = 800;

/// Removes the Gaussians of a scene that the photos of a capture do not need, by [`CleaningRules::ANY_SCENE`]. The
/// capture has cameras in the world of the scene, in any layout that [`posed::load`] takes; its photos are shrunk to
/// 800 pixels. The scene is drawn over a background by rules. `outcome` is of the run that made the scene, if it is
/// known: it has the photos' color corrections.
///
/// # Errors
/// When cameras or photos cannot be read, or the rasterizer refuses.
pub fn clean(
    scene: &Gaussians,
    capture: &Path,
    (background, raster): ([f32; 3], RasterSettings),
    outcome: Option<&Outcome>,
    observe: &mut dyn Observe,
) -> Result<(Gaussians, Cleaned), Error> {
    let options = PosedOptions { long_side: Some(LONG_SIDE), background, ..PosedOptions::default() };
    let photos: Vec<Photo> = posed::load(capture, &options)?.photos.into_iter().map(|photo| photo.photo).collect();
    let exposure = |photo: &Photo| outcome.and_then(|outcome| outcome.exposure_of(&photo.name)).unwrap_or_default();
    let exposures: Vec<_> = photos.iter().map(exposure).collect();
    let settings = FitSettings {
        gaussians: scene.len(),
        background,
        antialiased: raster.antialiased,
        exposure: true,
        ..FitSettings::default()
    };
    let mut fit = Fit::new(photos, scene, settings)?;
    fit.set_raster_settings(raster);
    fit.begin_exposures(exposures.into_iter());
    let rules = CleaningRules::ANY_SCENE;
    let total = rules.parts();
    observe.begin(&Stage { label: CLEAN, done: 0, total, stops_after: None });
    let cleaned = fit.clean_watched(&rules, |done| {
        // Half of a cleaning is none.
        let _ = observe.progress(&Part { label: CLEAN, done, total, note: String::new() });
    })?;
    Ok((fit.gaussians(), cleaned))
}
