//! How a file of Gaussians is drawn: by flags, else as the summary beside it says that it was made.

use crate::camera_files::{self, Size};
use crate::{Failure, memory};
use serde_json::Value;
use std::path::Path;
use weaver_io::{Drawing, SceneFile, read_scene};
use weaver_scene::Gaussians;
use weaver_splat::RasterSettings;

/// Longest side of the pictures that contributions are of: a Gaussian that shows at this size shows at any.
const LONG_SIDE: usize = 640;

/// Options of drawing a scene, from the command line or from a summary.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DrawingOptions {
    /// The color behind the scene, each part from 0 to 1.
    pub background: Option<[f32; 3]>,
    /// True if opacities are lowered where a Gaussian is widened to a pixel.
    pub antialiased: Option<bool>,
    /// The near plane, world units.
    pub near: Option<f64>,
    /// The largest opacity of a Gaussian at a pixel.
    pub alpha_max: Option<f64>,
}

impl DrawingOptions {
    /// Reads a scene, and how it is drawn: [`beside`](Self::beside).
    ///
    /// # Errors
    /// When the scene cannot be read, or the summary beside it has a wrong value.
    pub fn read(self, scene: &Path) -> Result<(Gaussians, [f32; 3], RasterSettings), Failure> {
        let SceneFile { gaussians, drawing } = read_scene(scene)?;
        let (background, settings) = self.beside(scene, drawing)?;
        Ok((gaussians, background, settings))
    }

    /// The background color and the rasterizer's settings: from these options, else from the summary beside the scene,
    /// else from the scene's file.
    pub fn beside(self, scene: &Path, file: Drawing) -> Result<([f32; 3], RasterSettings), Failure> {
        let summary = Self::of_summary(scene)?;
        let default = RasterSettings::default();
        let settings = RasterSettings {
            antialiased: self.antialiased.or(summary.antialiased).unwrap_or(file.antialiased),
            near: self.near.or(summary.near).unwrap_or(default.near),
            alpha_max: self.alpha_max.or(summary.alpha_max).unwrap_or(default.alpha_max),
            ..default
        };
        Ok((self.background.or(summary.background).unwrap_or([1.0; 3]), settings))
    }

    /// Contributions of the Gaussians of a scene to pictures by the cameras of a file, at most 640 pixels each.
    pub fn contributions(
        self,
        gaussians: &Gaussians,
        cameras: &Path,
        (scene, drawing): (&Path, Drawing),
    ) -> Result<Vec<f32>, Failure> {
        let mut cameras = camera_files::read(cameras, Size::default())?;
        cameras.iter_mut().for_each(|frame| frame.camera = frame.camera.shrunk(LONG_SIDE));
        memory::check(memory::of_pictures(&cameras, 1), "smaller cameras reduce it")?;
        let (background, settings) = self.beside(scene, drawing)?;
        Ok(weaver_fit::contributions(gaussians, cameras.iter().map(|frame| frame.camera), background, &settings)?)
    }

    /// Reads the summary.json in the scene's folder. There need not be one, and it need not say anything: a run of
    /// training has a file of that name as well.
    fn of_summary(scene: &Path) -> Result<Self, Failure> {
        let path = scene.with_file_name("summary.json");
        if !path.is_file() {
            return Ok(Self::default());
        }
        let text = weaver_io::read_text(&path)?;
        Self::parse(&text).map_err(|message| Failure::message(format!("{}: {message}", path.display())))
    }

    fn parse(text: &str) -> Result<Self, String> {
        let summary: Value = serde_json::from_str(text).map_err(|e| e.to_string())?;
        let color = |value: &Value| {
            let numbers =
                value.as_array()?.iter().map(|x| x.as_f64().map(|x| x as f32)).collect::<Option<Vec<f32>>>()?;
            <[f32; 3]>::try_from(numbers).ok().filter(|color| color.iter().all(|x| (0.0..=1.0).contains(x)))
        };
        let near = |value: &Value| value.as_f64().filter(|near| *near > 0.0);
        let alpha = |value: &Value| value.as_f64().filter(|alpha| *alpha > 0.0 && *alpha < 1.0);
        Ok(Self {
            antialiased: read(&summary, "antialiased", "true or false", Value::as_bool)?,
            near: read(&summary, "near", "a positive number", near)?,
            alpha_max: read(&summary, "alpha_max", "a number above 0 and below 1", alpha)?,
            background: read(&summary, "background", "three numbers from 0 to 1", color)?,
        })
    }
}

/// The value of a key, if there is one.
fn read<T>(summary: &Value, key: &str, expected: &str, of: impl Fn(&Value) -> Option<T>) -> Result<Option<T>, String> {
    match summary.get(key) {
        None => Ok(None),
        Some(value) => of(value).map(Some).ok_or_else(|| format!("{key}: expected {expected}, found {value}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_summary_says_what_it_says() {
        let whole = r#"{"steps": 7, "antialiased": true, "near": 0.5, "alpha_max": 0.9, "background": [0, 0.5, 1.0]}"#;
        let (near, alpha_max) = (Some(0.5), Some(0.9));
        let expected = DrawingOptions { antialiased: Some(true), near, alpha_max, background: Some([0.0, 0.5, 1.0]) };
        assert_eq!(DrawingOptions::parse(whole), Ok(expected));
        assert_eq!(DrawingOptions::parse(r#"{"preset": "micro"}"#), Ok(DrawingOptions::default()));
        for (text, part) in [
            ("{", "EOF"),
            (r#"{"near": 0}"#, "near: expected a positive number, found 0"),
            (r#"{"alpha_max": 1}"#, "alpha_max: expected a number above 0 and below 1, found 1"),
            (r#"{"antialiased": 1}"#, "antialiased: expected true or false, found 1"),
            (r#"{"background": [0, 1]}"#, "background: expected three numbers from 0 to 1, found [0,1]"),
            (r#"{"background": [0, 1, "x"]}"#, "background"),
        ] {
            let message = DrawingOptions::parse(text).unwrap_err();
            assert!(message.contains(part) && message.lines().count() == 1, "{message}");
        }
    }
}
