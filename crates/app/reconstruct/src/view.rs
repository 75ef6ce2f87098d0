//! view.html of a run: the scene to look at.

use crate::Error;
use crate::cameras::FOLDER;
use crate::fitting::Fitting;
use std::path::Path;
use weaver_fit::Photo;
use weaver_geometry::Camera;
use weaver_io::Bitmap;
use weaver_scene::Gaussians;
use weaver_view::{HtmlOptions, Look, Shot, Subject, html, photo_file, pictured};

/// The file of the page to look at the scene.
pub const FILE: &str = "view.html";

/// The page, with held-out photos at these cameras.
pub fn page(run: &Fitting, gaussians: &Gaussians, test_cameras: &[Camera]) -> Result<String, Error> {
    let title = title(&run.settings.capture);
    let look =
        Look { background: run.settings.fit.background, settings: run.fit().raster_settings(), ..Look::default() };
    let subject = Subject { title: &title, gaussians, look, notes: None, second: None };
    Ok(html(&subject, &shots(run, test_cameras)?, HtmlOptions::default())?)
}

/// The name of a capture's folder; of estimated cameras the result that they were estimated for.
fn title(capture: &Path) -> String {
    let is_camera_file = capture.extension().is_some_and(|extension| extension == "json");
    let folder = if is_camera_file { capture.parent().unwrap_or(capture) } else { capture };
    let folder = folder.parent().filter(|_| folder.ends_with(FOLDER)).unwrap_or(folder);
    folder.file_name().map_or("scene".into(), |name| name.to_string_lossy().into_owned())
}

/// All cameras, held-out ones first, and the photos of some of them.
pub fn shots(run: &Fitting, test_cameras: &[Camera]) -> Result<Vec<Shot>, Error> {
    let held_out = run.capture.held_out.iter().zip(test_cameras).map(|(photo, camera)| (photo, *camera, true));
    let fitted = (0..run.fit().photos()).map(|i| (run.fit().photo(i), run.fit().camera(i), false));
    let all: Vec<(&Photo, Camera, bool)> = held_out.chain(fitted).collect();
    let chosen = pictured(&all.iter().map(|(.., held_out)| *held_out).collect::<Vec<_>>());
    let shot = |(i, (photo, camera, held_out)): (usize, (&Photo, Camera, bool))| {
        let Camera { width, height, .. } = photo.camera;
        let file = || photo_file(&Bitmap { width, height, pixels: photo.rgb.to_vec() });
        let photo_file = chosen.contains(&i).then(file).transpose().map_err(weaver_view::ViewError::from)?;
        let coverage = run.capture.coverage.0.get(&photo.name).copied();
        Ok(Shot { held_out, photo: photo_file, coverage, ..Shot::new(photo.name.clone(), camera) })
    };
    all.into_iter().enumerate().map(shot).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_are_called_after_captures_and_results() {
        let titles = ["/data/fox", "/data/fox/transforms.json", "/data/scene/cameras/transforms.json", "/"];
        assert_eq!(titles.map(|capture| title(Path::new(capture))), ["fox", "fox", "scene", "scene"]);
    }
}
