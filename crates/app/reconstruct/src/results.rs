//! The end of a run: scene, cameras, judgment, report.

use crate::compressed;
use crate::fitting::Fitting;
use crate::judged::Judged;
use crate::loaded::{Loaded, Origin};
use crate::outcome::{Outcome, PoseChange, Views};
use crate::run::{MODEL, TRANSIENTS, file_of_scene};
use crate::{Error, Run, report, view};
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;
use weaver_fit::{CleaningRules, Exposure, Judge, Quality};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Pose, Similarity};
use weaver_io::colmap::{Model, Point};
use weaver_io::{Bitmap, Drawing, OutputFolder, Transforms, write_scene, write_text};
use weaver_scene::{Frame, Photo};
use weaver_sfm::carried;

/// Decibels below the median from which a photo is an outlier.
const OUTLIER: f64 = 8.0;
/// Steps that locate a held-out photo.
const LOCATE: usize = 30;
/// Fitted photos that are judged, at most: more would say no more, and take time from the steps.
pub(crate) const JUDGED: usize = 64;
/// Views that are judged side by side, and their pixels, at most.
const BATCH: (usize, usize) = (16, 32 << 20);

impl Run {
    /// Writes scene, cameras, summary and report, then the page to look at the scene and further formats, whose failure
    /// leaves the other results intact. A scene that no page can hold has none, listed in [`Outcome::missing`].
    ///
    /// # Errors
    /// When a file cannot be written, or the rasterizer refuses.
    pub fn finish(&mut self) -> Result<Outcome, Error> {
        let weaver_run::Run { folder, job } = &mut self.0;
        let out = folder.out();
        job.capture.fit.fetch()?;
        if let Some(level) = job.settings.compress {
            compressed::write(&out.file(compressed::FILE)?, &job.fit().gaussians(), level)?;
            // All further results are of the scene as rounded in the file.
            job.capture.fit.settle()?;
        }
        let gaussians = job.fit().gaussians();
        let drawing = Drawing::antialiased(job.fit().raster_settings().antialiased);
        write_scene(out.file("scene.ply")?, &gaussians, drawing)?;
        let test_cameras = job.held_out_cameras()?;
        job.write_cameras(&test_cameras, out)?;
        let look = job.settings.html.then(|| view::page(job, &gaussians, &test_cameras)).transpose();
        let missing = look.as_ref().err().map(|error| format!("{}: {error}", view::FILE));
        let look = look.unwrap_or_default();
        let seconds = job.seconds();
        let test = job.judge_held_out(&test_cameras)?;
        let train = job.judge_training()?;
        let outliers = job.outliers(&train)?;
        let outcome = Outcome { missing: Vec::from_iter(missing), outliers, ..job.outcome(seconds, &train, &test) };
        job.write_transients(folder.out())?;
        folder.summarize(&outcome)?;
        let mut page = report::page(job, &outcome, look.as_deref(), (&train, &test))?;
        folder.report(page.curves(&folder.records()?, &report::CURVES))?;
        match &look {
            Some(look) => write_text(out.file(view::FILE)?, look)?,
            // One of an earlier end of the run.
            None if job.settings.html => out.remove(view::FILE)?,
            None => {}
        }
        for format in &job.settings.formats {
            write_scene(out.file(file_of_scene(format))?, &gaussians, drawing)?;
        }
        Ok(outcome)
    }
}

/// The most bytes of a photo's name within longer file names; file systems allow 255.
const STEM: usize = 200;

/// A name that leaves place for a number and another ending.
fn shortened(stem: &str) -> &str {
    &stem[..stem.floor_char_boundary(STEM)]
}

impl Fitting {
    fn outcome(&self, seconds: f64, train: &[Judged], test: &[Judged]) -> Outcome {
        let views = |judged: &[Judged]| {
            let all: Vec<Quality> = judged.iter().map(|j| j.quality).collect();
            Quality::mean(&all).map(|quality| Views { views: all.len(), quality })
        };
        let nothing = Views { views: 0, quality: Quality { psnr: f64::NAN, ..Quality::default() } };
        let raster = self.fit().raster_settings();
        let camera = &self.fit().photo(0).camera;
        Outcome {
            steps: self.fit().steps_done(),
            planned: self.settings.fit.steps,
            left_out: self.settings.fit.left_out(self.fit().steps_done()),
            seconds,
            gaussians: self.fit().population().len(),
            size: [camera.width, camera.height],
            train: views(train).unwrap_or(nothing),
            test: views(test),
            poses: self.pose_change(),
            antialiased: raster.antialiased,
            near: raster.near,
            alpha_max: raster.alpha_max,
            background: self.settings.fit.background,
            exposures: self.exposures(test),
            transients: self.transients(),
            cleaning: self.cleaning,
            coverage: self.capture.coverage.clone(),
            outliers: Vec::new(),
            missing: Vec::new(),
        }
    }

    /// Fitted photos that are met far worse than the others: those that were judged at their own size, and the others
    /// at a glance.
    fn outliers(&mut self, judged: &[Judged]) -> Result<Vec<String>, Error> {
        let own: Vec<_> = judged.iter().map(|j| (j.name.as_str(), j.quality.psnr)).collect();
        let mut found = outliers(&own);
        let others = (0..self.fit().photos()).filter(|photo| judged.iter().all(|j| j.number != *photo));
        let others: Vec<usize> = if self.is_late() { Vec::new() } else { others.collect() };
        let glances = others.iter().map(|photo| self.capture.fit.glance(*photo));
        let glances = glances.collect::<Result<Vec<f64>, _>>()?;
        let others = others.iter().map(|photo| self.fit().photo(*photo).name.as_str()).zip(glances);
        found.extend(outliers(&others.collect::<Vec<_>>()));
        Ok(found)
    }

    fn exposures(&self, test: &[Judged]) -> BTreeMap<String, [f32; 12]> {
        let own = (0..self.fit().photos()).map(|i| (self.fit().photo(i).name.clone(), self.fit().exposure(i).copied()));
        let near = test.iter().map(|judged| (judged.name.clone(), self.fit().exposure_at(&judged.camera)));
        own.chain(near).filter_map(|(name, exposure)| Some((name, exposure?.matrix))).collect()
    }

    fn transients(&self) -> BTreeMap<String, f64> {
        let fit = self.fit();
        (0..fit.photos()).filter_map(|i| Some((fit.photo(i).name.clone(), fit.transients(i)?.part()))).collect()
    }

    /// Writes the transients of photos as masks: white counts, black was left out.
    fn write_transients(&self, out: &OutputFolder) -> Result<(), Error> {
        let mut names = Vec::new();
        for photo in 0..self.fit().photos() {
            let Some(transients) = self.fit().transients(photo) else { continue };
            let Photo { name, camera: Camera { width, height, .. }, .. } = self.fit().photo(photo);
            let (width, height) = (*width, *height);
            let hidden = transients.at_size(width, height);
            let pixels = hidden.iter().flat_map(|hidden| [if *hidden { 0 } else { u8::MAX }; 3]).collect();
            let stem = Path::new(name).file_stem().unwrap_or_default().to_string_lossy();
            let name = format!("{TRANSIENTS}/{photo:04}-{}.png", shortened(&stem));
            Bitmap { width, height, pixels }.write_png(out.file(&name)?)?;
            names.push(name);
        }
        // A run that went on may have found other parts before.
        Ok(out.remove_others(TRANSIENTS, &names)?)
    }

    fn pose_change(&self) -> PoseChange {
        let pairs: Vec<(Pose, Pose)> =
            (0..self.fit().photos()).map(|i| (self.capture.origins[i].given.pose, self.fit().camera(i).pose)).collect();
        let median = |of: &dyn Fn(&(Pose, Pose)) -> f64| {
            let mut all: Vec<f64> = pairs.iter().map(of).collect();
            all.sort_unstable_by(f64::total_cmp);
            all[all.len() / 2]
        };
        PoseChange {
            refined: self.settings.fit.poses.refine,
            degrees: median(&|(a, b)| a.angle_to(b).to_degrees()),
            distance: median(&|(a, b)| a.center().distance(b.center())) / self.fit().extent(),
            focal: self.fit().camera(0).intrinsics.fx / self.capture.origins[0].given.intrinsics.fx,
            points: self.capture.matching.map_or(0, |m| m.points),
            pixels: self.capture.matching.and_then(|m| m.pixels.is_finite().then_some(m.pixels)),
        }
    }

    /// The cameras that held-out photos are judged with: as given; where cameras were refined, as matched, carried
    /// along with the training cameras, and located in the scene, which is frozen.
    fn held_out_cameras(&mut self) -> Result<Vec<Camera>, Error> {
        let given: Vec<Camera> = self.capture.held_out.iter().map(|photo| photo.camera).collect();
        if !self.settings.fit.poses.refine {
            return Ok(given);
        }
        let poses = |of: &dyn Fn(usize) -> Camera| (0..self.fit().photos()).map(|i| of(i).pose).collect::<Vec<_>>();
        let (before, after) = (poses(&|i| self.fit().photo(i).camera), poses(&|i| self.fit().camera(i)));
        let carried = Similarity::fit_poses(&before, &after);
        let mut cameras = Vec::with_capacity(given.len());
        for (photo, mut camera) in self.capture.held_out.iter().zip(given) {
            if let Some(carried) = &carried {
                camera.pose = carried.apply_to_pose(&camera.pose);
            }
            cameras.push(self.capture.fit.locate(photo, camera, LOCATE)?);
        }
        Ok(cameras)
    }

    /// Writes transforms.json and a COLMAP model, with intrinsics and distortion of the photos as they are on disk.
    fn write_cameras(&self, test: &[Camera], out: &OutputFolder) -> Result<(), Error> {
        let fitted = (0..self.fit().photos()).map(|i| self.fit().camera(i)).chain(test.iter().copied());
        let cameras: Vec<Camera> = fitted
            .zip(&self.capture.origins)
            .map(|(camera, origin)| Camera { pose: camera.pose, ..origin.frame.camera })
            .collect();
        let absolute = |path: &PathBuf| std::path::absolute(path).unwrap_or(path.clone());
        // A name that no file of cameras can hold is no reason to lose a fit.
        let name = |path: &PathBuf| {
            weaver_io::relative_path(out.path(), path).unwrap_or_else(|_| absolute(path).display().to_string())
        };
        let frame = |(origin, camera): (&Origin, &Camera)| {
            let Frame { path, mask, distortion, time, number, .. } = &origin.frame;
            let mask = mask.as_ref().map(|file| name(file).into());
            Frame { distortion: *distortion, mask, time: *time, number: *number, ..Frame::new(name(path), *camera) }
        };
        let frames: Vec<Frame> = self.capture.origins.iter().zip(&cameras).map(frame).collect();
        let model = Model { points: self.points(), ..Model::from_frames(&frames) };
        model.write_binary(out.files(MODEL, Model::FILES)?)?;
        // The held-out photos are listed also if there are none.
        let test_filenames = Some(frames[self.fit().photos()..].iter().map(|frame| frame.name.clone()).collect());
        let origin = self.capture.world;
        Transforms { frames, test_filenames, origin, ..Transforms::default() }.write(out.file("transforms.json")?)?;
        Ok(())
    }

    /// The capture's points, moved with the cameras that see them where the fit refined these.
    fn points(&self) -> Vec<Point> {
        let cameras = |of: &dyn Fn(usize) -> Camera| (0..self.fit().photos()).map(of).collect::<Vec<_>>();
        let (before, after) = (cameras(&|i| self.fit().photo(i).camera), cameras(&|i| self.fit().camera(i)));
        let points = &self.capture.points;
        let point = |(id, (position, rgb)): (u64, (&[f32; 3], &[u8; 3]))| {
            let position = DVec3::from(position.map(f64::from));
            let moved = if before == after { position } else { carried(position, &before, &after) };
            Point { id, xyz: moved.to_array(), rgb: *rgb, error: 0.0, track: Vec::new() }
        };
        (1..).zip(points.positions.iter().zip(&points.colors)).map(point).collect()
    }

    /// True if a run that is to end in its time has used it up.
    fn is_late(&self) -> bool {
        self.keeping.is_some_and(|keeping| self.seconds() > keeping.seconds)
    }

    /// Judges the photos that were fitted: all, or evenly spread ones of many, fewer where the time of the run is
    /// over.
    fn judge_training(&mut self) -> Result<Vec<Judged>, Error> {
        let photos = self.fit().photos();
        let chosen = weaver_data::uniform(photos, photos.min(JUDGED));
        let batches = chosen.len().div_ceil(at_once(&self.fit().photo(0).camera));
        // Each batch is spread over all photos.
        let batch = |first: usize| chosen.iter().copied().skip(first).step_by(batches).collect::<Vec<usize>>();
        let shown: Vec<usize> = match self.capture.held_out.is_empty() {
            true => report::pictured(batch(0).len()).map(|i| batch(0)[i]).collect(),
            false => Vec::new(),
        };
        let mut judged = Vec::with_capacity(chosen.len());
        for first in 0..batches {
            if first > 0 && self.is_late() {
                break;
            }
            let batch = batch(first);
            let Self { capture: Loaded { fit, .. }, judge, .. } = self;
            let draw = |&i: &usize| {
                Ok(corrected(fit.render_through(fit.photo(i).model(), &fit.camera(i))?, fit.exposure(i).copied()))
            };
            let images = batch.iter().map(draw).collect::<Result<Vec<_>, Error>>()?;
            let views = batch.iter().zip(images).map(|(&i, image)| View {
                number: i,
                photo: fit.photo(i),
                camera: fit.camera(i),
                mask: fit.counted(i),
                image,
                shown: shown.contains(&i),
            });
            View::judge(views.collect(), judge, &mut judged);
        }
        judged.sort_by_key(|judged| judged.number);
        Ok(judged)
    }

    fn judge_held_out(&mut self, cameras: &[Camera]) -> Result<Vec<Judged>, Error> {
        let shown: Vec<usize> = report::pictured(cameras.len()).collect();
        let Self { capture: Loaded { fit, held_out, .. }, judge, .. } = self;
        let mut judged = Vec::with_capacity(cameras.len());
        let all: Vec<usize> = (0..cameras.len()).collect();
        for batch in all.chunks(at_once(&fit.photo(0).camera)) {
            let view = |&i: &usize| {
                let (photo, camera): (&Photo, Camera) = (&held_out[i], cameras[i]);
                let image = corrected(fit.render_through(photo.model(), &camera)?, fit.exposure_at(&camera));
                let mask = photo.mask.as_deref().map(Cow::Borrowed);
                Ok(View { number: i, photo, camera, mask, image, shown: shown.contains(&i) })
            };
            View::judge(batch.iter().map(view).collect::<Result<_, Error>>()?, judge, &mut judged);
        }
        Ok(judged)
    }

    /// Seconds that looks and that results will take, from judging one photo now; with a full budget of Gaussians,
    /// glances at the photos that are not judged, and pictures for the report it takes longer.
    pub(crate) fn seconds_of_results(&mut self) -> Result<[f64; 2], Error> {
        let (camera, model) = (self.fit().camera(0), self.fit().photo(0).model());
        let mut seconds = [0.0; 2];
        // The first photo meets cold memory.
        for _ in 0..2 {
            let start = Instant::now();
            let image = self.capture.fit.render_through(model, &camera)?;
            let drawn = start.elapsed().as_secs_f64();
            quality(&self.judge, &image, self.fit().photo(0), None);
            seconds = [drawn, start.elapsed().as_secs_f64() - drawn];
        }
        let [draw, compare] = seconds;
        let views = self.fit().photos().min(JUDGED) + self.capture.held_out.len();
        let of_view = draw + compare / rayon::current_num_threads() as f64;
        let cleans = self.settings.fit.clean;
        let cleaning = if cleans { self.fit().seconds_of_cleaning(&CleaningRules::default())? } else { 0.0 };
        Ok([1.3 * draw * self.looks() as f64, 0.3 + 1.8 * of_view * views as f64 + cleaning])
    }
}

/// The number of views that are judged side by side, by one of their cameras.
fn at_once(camera: &Camera) -> usize {
    let (views, pixels) = BATCH;
    (pixels / (camera.width * camera.height)).clamp(1, views)
}

/// A view to judge: a photo, and the drawing from its camera.
struct View<'a> {
    number: usize,
    photo: &'a Photo,
    camera: Camera,
    /// The pixels that count.
    mask: Option<Cow<'a, [bool]>>,
    image: Vec<f32>,
    /// True if the report shows the drawing.
    shown: bool,
}

impl View<'_> {
    /// Judges views side by side: drawing has the processor to itself, and comparing takes one thread of it.
    fn judge(views: Vec<Self>, judge: &Judge, to: &mut Vec<Judged>) {
        to.par_extend(views.into_par_iter().map(|Self { number, photo, camera, mask, image, shown }| {
            let quality = quality(judge, &image, photo, mask.as_deref());
            Judged { name: photo.name.clone(), number, camera, image: shown.then_some(image), quality }
        }));
    }
}

/// A drawing in the light of a photo.
pub(crate) fn corrected(image: Vec<f32>, exposure: Option<Exposure>) -> Vec<f32> {
    let Some(exposure) = exposure else { return image };
    let mut corrected = vec![0.0; image.len()];
    exposure.apply(&image, &mut corrected);
    corrected
}

/// Quality of an image beside a photo, where pixels count.
pub(crate) fn quality(judge: &Judge, image: &[f32], photo: &Photo, mask: Option<&[bool]>) -> Quality {
    judge.compare_inside(image, &photo.rgb, [photo.camera.height, photo.camera.width], mask)
}

/// The names of those whose PSNR is far below the median.
fn outliers(judged: &[(&str, f64)]) -> Vec<String> {
    let mut all: Vec<f64> = judged.iter().map(|(_, psnr)| *psnr).collect();
    all.sort_unstable_by(f64::total_cmp);
    let Some(median) = all.get(all.len() / 2) else { return Vec::new() };
    judged.iter().filter(|(_, psnr)| *psnr < median - OUTLIER).map(|(name, _)| name.to_string()).collect()
}

#[cfg(test)]
mod tests {
    use super::shortened;

    /// A photo's name may be as long as file systems take; a file that has it in its name, and more, can be written.
    ///
    /// Promise (servers): a photo's name of any length leaves place for the files that are named after it.
    #[test]
    fn long_names_of_photos_leave_place() {
        assert_eq!(shortened("IMG_0001"), "IMG_0001");
        for stem in ["x".repeat(251), "\u{fc}".repeat(125), format!("x{}", "\u{1f600}".repeat(62))] {
            let name = format!("0000-{}.png", shortened(&stem));
            assert!(name.len() <= 255 && stem.starts_with(shortened(&stem)), "{name}");
        }
    }
}
