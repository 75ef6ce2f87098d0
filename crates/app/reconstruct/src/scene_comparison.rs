//! A finished scene beside the photos of a capture.

use crate::{Error, Outcome};
use serde_json::{Value, json};
use std::fmt;
use std::path::Path;
use weaver_data::capture::posed::{self, PosedOptions};
use weaver_fit::{Judge, Quality};
use weaver_io::{Observe, Part, Stage};
use weaver_scene::{Gaussians, Photo};
use weaver_splat::{RasterSettings, Renderer};

/// A scene to compare with photos.
#[derive(Clone, Copy, Debug)]
pub struct ComparedScene<'a> {
    /// File of the scene, beside which the summary of its fit has the color corrections of photos.
    pub file: &'a Path,
    /// The scene.
    pub gaussians: &'a Gaussians,
    /// Settings of drawing it; its background is that of the [options](PosedOptions::background).
    pub settings: RasterSettings,
}

/// Quality of a scene from the photos of a capture; displayed as a table.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneComparison {
    /// Quality of each photo, by its name.
    pub views: Vec<(String, Quality)>,
    /// Mean quality.
    pub mean: Quality,
    /// True if the photos are held out by the capture, false if they are all of its photos.
    pub held_out: bool,
}

impl SceneComparison {
    /// Draws a scene from the cameras of a capture's held-out photos, or of all photos where none are held out, and
    /// compares.
    ///
    /// # Errors
    /// When the scene is empty, the capture cannot be read or has no photo, or the rasterizer refuses.
    pub fn of(
        scene: &ComparedScene<'_>,
        data: &Path,
        options: &PosedOptions,
        (judge, renderer): (&Judge, &mut Renderer),
        observe: &mut dyn Observe,
    ) -> Result<Self, Error> {
        let ComparedScene { file, gaussians, settings } = scene;
        let none = |path: &Path, expected| Error::Nothing { path: path.into(), expected };
        if gaussians.is_empty() {
            return Err(none(file, "Gaussians to judge"));
        }
        let capture = posed::load(data, options)?;
        capture.remarks.iter().for_each(|remark| observe.warning(remark));
        let held_out = capture.photos.iter().any(|photo| photo.held_out);
        // Of a photo that is masked altogether, nothing can be judged.
        let photos = capture.photos.into_iter().map(|posed| posed.photo).filter(|photo| !photo.is_masked());
        let photos: Vec<Photo> = photos.collect();
        if !held_out {
            observe.note(&format!("{}: no photo is held out; these are all of them", data.display()));
        }
        let fit = Outcome::beside(file);
        let activated = gaussians.to_activated();
        observe.begin(&Stage { label: "compare", done: 0, total: photos.len(), stops_after: None });
        let mut views = Vec::with_capacity(photos.len());
        for photo in &photos {
            let drawn =
                renderer.render_through(photo.model(), &activated, &[photo.camera], options.background, settings);
            let mut image = drawn.map_err(|source| Error::Drawing { scene: file.into(), source })?.concat();
            if let Some(exposure) = fit.as_ref().and_then(|fit| fit.exposure_of(&photo.name)) {
                let drawn = image.clone();
                exposure.apply(&drawn, &mut image);
            }
            let quality = judge.compare_inside(&image, &photo.rgb, photo.size(), photo.mask.as_deref());
            views.push((photo.name.clone(), quality));
            let part = Part { label: "compare", done: views.len(), total: photos.len(), note: String::new() };
            let _ = observe.progress(&part);
        }
        let all: Vec<Quality> = views.iter().map(|(_, quality)| *quality).collect();
        let mean = Quality::mean(&all).ok_or_else(|| none(data, "at least one photo"))?;
        Ok(Self { views, mean, held_out })
    }

    /// The comparison of a scene's file as JSON.
    pub fn json(&self, file: &Path, gaussians: usize) -> Value {
        let figures = |Quality { psnr, psnr_aligned, ssim, lpips }: &Quality| json!({ "psnr": psnr, "psnr_aligned": psnr_aligned, "ssim": ssim, "lpips": lpips });
        let view = |(name, quality): &(String, Quality)| {
            let mut figures = figures(quality);
            figures["name"] = name.as_str().into();
            figures
        };
        json!({
            "scene": file.display().to_string(),
            "gaussians": gaussians,
            "held_out": self.held_out,
            "views": self.views.iter().map(view).collect::<Vec<_>>(),
            "mean": figures(&self.mean),
        })
    }
}

impl fmt::Display for SceneComparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.views.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0).max("mean".len());
        let number = |value: Option<f64>, digits| value.map_or("-".into(), |value| format!("{value:.digits$}"));
        writeln!(f, "{:<width$}     PSNR  aligned    SSIM   LPIPS", "view")?;
        let views = self.views.iter().map(|(name, quality)| (name.as_str(), quality));
        for (name, quality) in views.chain([("mean", &self.mean)]) {
            let Quality { psnr, psnr_aligned, ssim, lpips } = *quality;
            let (aligned, ssim, lpips) = (number(psnr_aligned, 2), number(ssim, 4), number(lpips, 4));
            writeln!(f, "{name:<width$}  {psnr:>7.2}  {aligned:>7}  {ssim:>6}  {lpips:>6}")?;
        }
        Ok(())
    }
}
