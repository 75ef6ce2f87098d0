//! Films for the viewer.

use crate::run::{MODEL, Run};
use std::path::Path;
use weaver_command::{DrawingOptions, Failure};
use weaver_data::film;
use weaver_io::{Bitmap, Drawing, Image};
use weaver_view::{Look, Shot, ViewError, photo_file};
use weaver_view_run::{Moving, ScenePage};

/// Initial moment of a page.
const MOMENT: f64 = 0.5;
/// Most cameras of a page: a hand-held film has one for each photo.
const SHOTS: usize = 100;

/// An expert of the run in a folder, at any time: the named one, or the one trained last.
///
/// # Errors
/// When the run cannot be read, or has no such expert.
pub fn film(
    folder: &Path,
    expert: Option<&str>,
    drawing: DrawingOptions,
    meters: Option<f64>,
) -> Result<ScenePage, Failure> {
    let run = Run::open(folder)?;
    let expert = match expert {
        Some(name) => run.settings().expert(name)?,
        None => run.expert_at_hand(),
    };
    let report = Some(folder.join("report.html")).filter(|path| path.is_file());
    let asked = DrawingOptions { background: drawing.background.or(Some(run.film().background)), ..drawing };
    let (background, settings) = asked.beside(&folder.join(MODEL), Drawing::default())?;
    let look = Look { background, settings, meters };
    let moving = Some(Moving::new(run.moments(expert)));
    Ok(ScenePage { look, moving, report, ..scene_page(&run, expert, folder)? })
}

/// The present state of a run's expert, with the photos taken nearest to the moment; held-out ones come first.
pub(super) fn scene_page(run: &Run, expert: usize, folder: &Path) -> Result<ScenePage, Failure> {
    let film = run.film();
    let shot = |shot: &film::Shot| -> Result<Shot, Failure> {
        let image = shot.image(film.size)?;
        let Image { width, height, .. } = image;
        let photo = photo_file(&Bitmap { width, height, pixels: image.to_bytes() }).map_err(ViewError::from)?;
        let held_out = !shot.held_out.trained();
        Ok(Shot { held_out, photo: Some(photo), ..Shot::new(shot.name.clone(), shot.camera) })
    };
    let mut shots = run.shots_near(MOMENT);
    shots.sort_by_key(|shot| shot.held_out.trained());
    let shots = shots.into_iter().take(SHOTS).map(shot).collect::<Result<_, _>>()?;
    let look = Look { background: film.background, ..Look::default() };
    Ok(ScenePage { shots, ..ScenePage::new(folder.display().to_string(), run.moments(expert)(MOMENT), look) })
}
