//! The path of a film: `--path`.

use crate::Failure;
use crate::camera_files::{self, Size};
use std::path::{Path, PathBuf};
use weaver_geometry::glam::DVec3;
use weaver_scene::{CameraPath, Frame, Keyframes};

/// Cameras of a path along cameras, unless another number is given.
const PICTURES: usize = 120;
/// Cameras of a path at most.
const MOST: f64 = 100_000.0;

/// The path of a film: along the cameras of a capture, or through keyframes in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FilmPath {
    /// Along given cameras.
    Along(CameraPath),
    /// Through the cameras of a transforms.json that has a `time` for each of them.
    Through(PathBuf),
}

/// A parser of `--path`: `ellipse`, `spline`, `dolly`, or the name of a JSON file.
///
/// # Errors
/// A sentence about other text.
pub fn film_path(text: &str) -> Result<FilmPath, String> {
    Ok(match text {
        "ellipse" => FilmPath::Along(CameraPath::Ellipse),
        "spline" => FilmPath::Along(CameraPath::Spline),
        "dolly" => FilmPath::Along(CameraPath::Dolly),
        file if Path::new(file).extension().is_some_and(|end| end.eq_ignore_ascii_case("json")) => {
            FilmPath::Through(file.into())
        }
        _ => return Err("expected ellipse, spline, dolly, or a file of keyframes (.json)".into()),
    })
}

impl FilmPath {
    /// The file of keyframes.
    pub fn file(&self) -> Option<&PathBuf> {
        match self {
            Self::Along(_) => None,
            Self::Through(file) => Some(file),
        }
    }

    /// The cameras of the path. `pictures` is their number. Without it, keyframes get `fps` pictures for each of their
    /// seconds, and the last one. `along` are the cameras of `--cameras`, `middle` a point of the scene to look at
    /// where they do not agree on one.
    ///
    /// # Errors
    /// When there are cameras and keyframes, or neither; when the file of keyframes cannot be read, or they are no
    /// path ([`Keyframes::new`]).
    pub fn cameras(
        &self,
        along: Option<&[Frame]>,
        (pictures, fps): (Option<u32>, f64),
        size: Size,
        middle: DVec3,
    ) -> Result<Vec<Frame>, Failure> {
        let pictures = pictures.map(|count| count as usize);
        match (self, along) {
            (Self::Along(path), Some(cameras)) => Ok(path.along(cameras, pictures.unwrap_or(PICTURES), middle)),
            (Self::Along(_), None) => Err(Failure::Usage("--path: expected --cameras to go along, found none".into())),
            (Self::Through(_), Some(_)) => {
                Err(Failure::Usage("--path: expected keyframes without --cameras, found both".into()))
            }
            (Self::Through(file), None) => {
                let keys = Keyframes::new(&camera_files::read(file, size)?)
                    .map_err(|error| Failure::message(format!("{}: {error}", file.display())))?;
                let wanted = 1.0 + (keys.seconds() * fps).round();
                if pictures.is_none() && wanted > MOST {
                    let found = format!("{} seconds at {fps} a second", keys.seconds());
                    return Err(Failure::message(format!(
                        "{}: expected at most {MOST} pictures, found {found}; --pictures sets their number",
                        file.display()
                    )));
                }
                Ok(keys.frames(pictures.unwrap_or(wanted as usize)))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::{Camera, Intrinsics, Pose};
    use weaver_io::Transforms;

    fn keys(path: &Path, times: &[Option<f64>]) {
        let intrinsics = Intrinsics { fx: 100.0, fy: 100.0, cx: 40.0, cy: 30.0 };
        let key = |(i, time): (usize, &Option<f64>)| {
            let pose = Pose::new(Default::default(), DVec3::X * i as f64);
            Frame { time: *time, ..Frame::new(format!("key-{i}"), Camera { pose, intrinsics, width: 80, height: 60 }) }
        };
        let frames = times.iter().enumerate().map(key).collect();
        Transforms { frames, ..Transforms::default() }.write(path).unwrap();
    }

    #[test]
    fn names_and_files_are_paths() {
        assert_eq!(film_path("dolly"), Ok(FilmPath::Along(CameraPath::Dolly)));
        assert_eq!(film_path("a/Path.JSON"), Ok(FilmPath::Through("a/Path.JSON".into())));
        assert!(film_path("circle").unwrap_err().contains("ellipse, spline, dolly"));
    }

    #[test]
    fn keys_make_as_many_pictures_as_they_take() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("path.json");
        let path = FilmPath::Through(file.clone());
        let cameras =
            |pictures| path.cameras(None, (pictures, 30.0), Size { width: Some(160), height: None }, DVec3::ZERO);
        let said = |failed: Result<Vec<Frame>, Failure>| format!("{:?}", failed.unwrap_err());
        assert!(said(cameras(None)).contains("path.json"));
        keys(&file, &[Some(0.0), Some(1.5)]);
        let film = cameras(None).unwrap();
        assert_eq!((film.len(), film[0].camera.width, film[0].camera.height), (46, 160, 120));
        assert!((film[45].camera.pose.translation.x - 1.0).abs() < 1e-12);
        assert_eq!(cameras(Some(7)).unwrap().len(), 7);
        keys(&file, &[Some(0.0), Some(1.5), Some(1.5)]);
        let message = said(cameras(None));
        assert!(message.contains("path.json: frames[2].time: expected a time after 1.5, found 1.5"), "{message}");
        keys(&file, &[Some(0.0)]);
        assert!(said(cameras(None)).contains("at least two keys"));
        keys(&file, &[Some(0.0), Some(1e9)]);
        assert!(said(cameras(None)).contains("at most 100000 pictures"));
        assert!(
            said(path.cameras(Some(&[]), (None, 30.0), Size::default(), DVec3::ZERO)).contains("without --cameras")
        );
        let along = FilmPath::Along(CameraPath::Dolly).cameras(None, (None, 30.0), Size::default(), DVec3::ZERO);
        assert!(said(along).contains("expected --cameras"));
    }
}
