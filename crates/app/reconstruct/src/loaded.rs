//! A capture, ready to be fitted.

use crate::compressed;
use crate::depths;
use crate::matching::Matching;
use crate::sources::Sources;
use crate::start::{Seen, Start};
use crate::{ByPhotos, Coverage, Error, Initial, RunSettings, plan};
use std::path::Path;
use std::sync::Arc;
use weaver_data::posed::{self, PosedPhoto, PosedPhotos};
use weaver_data::some_of;
use weaver_fit::{ColorAgreement, Density, Exposure, Fit, FitRasterizer, FitSettings, Rates, mean_color};
use weaver_geometry::{Camera, geodesy};
use weaver_io::ScratchFile;
use weaver_scene::{Frame, Gaussians, Photo, PointCloud};

/// A photo on disk.
#[derive(Clone, Debug)]
pub(crate) struct Origin {
    /// The file, with its entry in the capture.
    pub frame: Frame,
    /// The camera of the photo as it is fitted, before refinement.
    pub given: Camera,
}

/// A capture, ready to be fitted.
#[derive(Debug)]
pub(crate) struct Loaded {
    pub fit: Fit,
    pub held_out: Vec<Photo>,
    /// Origins of the training photos, then of the held-out ones.
    pub origins: Vec<Origin>,
    /// The capture's points, where its cameras are as they are before the fit.
    pub points: PointCloud,
    /// The origin of the world, where the capture has one.
    pub world: Option<geodesy::Origin>,
    pub matching: Option<Matching>,
    /// True if photos agree about colors.
    pub colors: ColorAgreement,
    /// Gaussians that the run begins with, where they were found from the photos: they are stored, so that it goes on
    /// from them.
    pub found: Option<Gaussians>,
    pub coverage: Coverage,
    /// A note about the photos whose depth counts, if any was asked for.
    pub depths: Option<String>,
    /// Checksums of the inputs.
    pub sources: Sources,
    /// Remarks for the user.
    pub remarks: Vec<String>,
}

/// Loads the inputs of a run, and decides [settings that depend on the photos](crate::ByPhotos). `given` are the
/// Gaussians of [`Initial::Given`]. Photos that memory has no room for are kept in a file without a name in `folder`,
/// where there is one.
pub(crate) fn load(
    settings: &mut RunSettings,
    given: Option<&Gaussians>,
    rasterizer: Arc<dyn FitRasterizer>,
    folder: Option<&Path>,
) -> Result<Loaded, Error> {
    settings.decide_lenses(&*rasterizer);
    let folder = if plan(settings)?.on_disk { folder } else { None };
    let scratch = folder.map(ScratchFile::new).transpose()?;
    let photos = posed::load_kept(&settings.capture, &settings.posed_options(), scratch.as_ref())?;
    prepare(settings, photos, given, rasterizer)
}

/// Prepares photos that were loaded.
pub(crate) fn prepare(
    settings: &mut RunSettings,
    mut capture: PosedPhotos,
    given: Option<&Gaussians>,
    rasterizer: Arc<dyn FitRasterizer>,
) -> Result<Loaded, Error> {
    let sources = Sources::of(&capture);
    let (mut training, mut held_out, mut visible) = (Vec::new(), Vec::new(), Vec::new());
    let (mut origins, mut held_out_origins, mut masked) = (Vec::new(), Vec::new(), Vec::new());
    for PosedPhoto { photo, frame, held_out: out, visible: sees } in capture.photos {
        // The optimization leaves out photos without a pixel that counts.
        if photo.is_masked() {
            masked.push(photo.name);
            continue;
        }
        let (photos, places) = if out { (&mut held_out, &mut held_out_origins) } else { (&mut training, &mut origins) };
        places.push(Origin { frame, given: photo.camera });
        photos.push(photo);
        if !out {
            visible.push(sees);
        }
    }
    if let Some(views) = settings.views {
        let chosen = weaver_data::uniform(training.len(), views.clamp(1, training.len().max(1)));
        training = chosen.iter().map(|i| training[*i].clone()).collect();
        visible = chosen.iter().map(|i| visible[*i].clone()).collect();
        origins = chosen.iter().map(|i| origins[*i].clone()).collect();
    }
    origins.append(&mut held_out_origins);
    if training.is_empty() {
        let expected = "at least one that is not held out, with pixels that count";
        let found = format!("{} held out, none other", held_out.len());
        return Err(Error::Photos {
            capture: settings.capture.clone(),
            key: "photos",
            expected: expected.into(),
            found,
        });
    }
    let colors = ColorAgreement::of(&training, &capture.points, &visible);
    // Decisions go into run.json, so that a run goes on as it began.
    let undecided = settings.by_photos.clone();
    let by_photos = |setting| undecided.contains(&setting);
    settings.fit.exposure |= by_photos(ByPhotos::Exposure) && colors.differ();
    if by_photos(ByPhotos::Background) && !capture.transparent {
        settings.fit.background = mean_color(&training);
    }
    if by_photos(ByPhotos::Dropout) {
        settings.fit.dropout = FitSettings::dropout_for(training.len());
    }
    if by_photos(ByPhotos::Fade) {
        settings.fit.density.opacity_weight = Density::opacity_weight_for(training.len());
    }
    if by_photos(ByPhotos::Opacities) {
        settings.fit.rates.opacities = Rates::opacities_for(training.len());
    }
    let sides = training.iter().map(|photo| photo.camera.width.max(photo.camera.height));
    let long_side = sides.max().unwrap_or_default();
    if by_photos(ByPhotos::Coarse) {
        (settings.fit.halvings, settings.fit.coarse_until) = FitSettings::coarse_for(long_side);
    }
    // The file of a fisheye's photo with another focal length would have no distortion that can be written.
    let refocusable = |origin: &Origin| origin.frame.distortion.is_none_or(|d| d.refocused(1.0).is_some());
    let refocus = settings.focal && origins.iter().all(refocusable);
    // Matching knows pinholes.
    let wide = training.iter().chain(&held_out).any(|photo| photo.lens.is_some());
    let matching = (settings.fit.poses.refine && !wide)
        .then(|| Matching::refine(&mut training, &mut held_out, &mut capture.points, refocus));
    if let Some(Matching { focal, .. }) = matching.filter(|_| refocus) {
        for origin in &mut origins {
            let Frame { camera, distortion, .. } = &mut origin.frame;
            camera.intrinsics.fx *= focal;
            camera.intrinsics.fy *= focal;
            *distortion = distortion.and_then(|distortion| distortion.refocused(focal));
        }
    }
    let uses_depth = settings.fit.surfaces.depth > 0.0;
    let known = if uses_depth {
        depths::of_files(&settings.capture, &training, |photo| &origins[photo].frame)?
    } else {
        Vec::new()
    };
    let finds_depth = uses_depth && known.is_empty();
    let seen = Seen { photos: &training, points: &capture.points, visible: &visible, finds_depth };
    let start = Start::of(settings, seen, given)?;
    if by_photos(ByPhotos::Means) && settings.init == Initial::Dense {
        settings.fit.rates.means = Rates::means_on_surfaces(long_side);
    }
    let mut remarks = capture.remarks;
    if wide {
        let lenses = "photos of 120 degrees or more are drawn through their own lens (--undistort undoes it)";
        remarks.push(format!("{}: {lenses}", settings.capture.display()));
    }
    if !masked.is_empty() {
        let have = if masked.len() == 1 { "is" } else { "are" };
        remarks.push(format!("{} {have} left out: masks cover all of it", some_of(&masked)));
    }
    if settings.init == Initial::Auto && capture.points.is_empty() {
        remarks.push(format!(
            "{}: no points: Gaussians begin at random, which costs quality; `splatweaver cameras` finds points",
            settings.capture.display()
        ));
    }
    let strategy = settings.fit.density.strategy();
    let mut fit = Fit::with(rasterizer, strategy, training, &start.gaussians, settings.fit.clone())?;
    fit.begin_exposures(colors.gains.iter().map(|gains| Exposure::of_gains(*gains)));
    let Start { gaussians, coverage, searched, depths } = start;
    let by = if known.is_empty() { "as they agree about it" } else { "by depth_file_path" };
    let known: Vec<_> = known.into_iter().chain(depths).collect();
    if uses_depth && known.is_empty() {
        remarks.push(format!("{}: no photo has a depth, and none is fitted", settings.capture.display()));
    }
    let depths = (!known.is_empty()).then(|| format!("the depth of {} photos counts, {by}", known.len()));
    for (photo, depth) in known {
        fit.set_depth(photo, depth)?;
    }
    if let Some(level) = settings.compress {
        compressed::train_for(&mut fit, level);
    }
    settings.by_photos.clear();
    let found = searched.then_some(gaussians);
    let (points, world) = (capture.points, capture.origin);
    Ok(Loaded { fit, held_out, origins, points, world, matching, colors, found, coverage, depths, sources, remarks })
}
