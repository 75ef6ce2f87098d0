//! Disturbs the cameras of a capture, refines them with the scene, and prints how far they came back:
//! `disturbed_cameras FOLDER [degrees=1] [percent=1] [focal=0] [steps=1500] [gaussians=30000] [seed=0] [points=moved]
//! [fits=true,true-refined,fixed,refined] [settings={}]`.
//!
//! Refinement works as in `splatweaver fit --poses refine`: cameras are matched, then go toward the scene while it is
//! fitted; `matched` leaves out the latter, `cameras` the whole fit.
//!
//! Every camera, held-out ones too, is turned by `degrees` about a random axis and moved by `percent` of its distance
//! to the scene (median depth of the points that it sees) in a random direction; focal lengths are wrong by `focal`
//! percent. Points are as wrong as the cameras: each goes where a random camera that sees it would put it, at its true
//! depth; with `points=given` they stay where they are, which shows cameras where to go; with `points=none` Gaussians
//! begin at random.
//!
//! Errors of poses are medians over training photos after the similarity that best lays their centers on the true ones.

use std::collections::BTreeMap;
use std::error::Error;
use std::time::Instant;
use weaver_data::posed::{self, PosedOptions};
use weaver_fit::{Fit, FitSettings, Judge, Photo, init};
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::{Camera, Pose, Similarity, so3};
use weaver_kernels::random::Stream;
use weaver_scene::PointCloud;
use weaver_sfm::{RefineSettings, Refined, View, carried};

type Outcome<T> = Result<T, Box<dyn Error>>;

/// Gauss-Newton steps that locate a held-out photo.
const LOCATE: usize = 30;

fn main() -> Outcome<()> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().ok_or("expected the folder of a capture")?;
    let mut given = BTreeMap::new();
    for argument in arguments {
        let (key, value) = argument.split_once('=').ok_or("expected KEY=VALUE")?;
        given.insert(key.to_string(), value.to_string());
    }
    let number = |key: &str, default: f64| given.get(key).map_or(Ok(default), |text| text.parse());
    let (steps, gaussians) = (number("steps", 1500.0)? as usize, number("gaussians", 30_000.0)? as usize);
    let mut settings = serde_json::to_value(FitSettings { steps, gaussians, ..FitSettings::default() })?;
    if let Some(json) = given.get("settings") {
        merge(&mut settings, serde_json::from_str(json)?);
    }
    let settings: FitSettings = serde_json::from_value(settings)?;
    let stream = Stream::new(number("seed", 0.0)? as u64, 0, "example.disturbed");
    let points = given.get("points").map_or("moved", String::as_str);
    let truth = Capture::load(&folder)?;
    let by = Disturbance {
        angle: number("degrees", 1.0)?.to_radians(),
        distance: 0.01 * number("percent", 1.0)?,
        focal: 1.0 + 0.01 * number("focal", 0.0)?,
    };
    let mut disturbed = truth.disturbed(&by, stream);
    match points {
        "moved" => {}
        "given" => disturbed.points = truth.points.clone(),
        "none" => disturbed.points = PointCloud::default(),
        _ => return Err("points: expected moved, given or none".into()),
    }
    let matched = |capture: &Capture| -> Outcome<Capture> {
        let start = Instant::now();
        let (capture, found) = capture.matched(by.focal != 1.0);
        let cameras: Vec<Camera> = capture.training.iter().map(|photo| photo.camera).collect();
        let [degrees, percent] = truth.errors(&cameras)?;
        let focal = 100.0 * (cameras[0].intrinsics.fx / truth.training[0].camera.intrinsics.fx - 1.0);
        let (points, pixels, seconds) = (found.points.len(), found.error, start.elapsed().as_secs_f64());
        println!(
            "     matched: {degrees:.3} degrees, {percent:.3} % of the distance, focal {focal:+.2} %; {points} points, {pixels:.2} pixels; {seconds:.0} s"
        );
        Ok(capture)
    };
    let refine = |settings: &FitSettings| {
        let mut settings = settings.clone();
        settings.poses.refine = true;
        settings
    };
    let fixed = FitSettings { poses: weaver_fit::Poses::default(), ..settings.clone() };
    for fit in given.get("fits").map_or("true,true-refined,fixed,refined", String::as_str).split(',') {
        let (capture, settings) = match fit {
            "true" => (&truth, fixed.clone()),
            "true-refined" => (&matched(&truth)?, refine(&settings)),
            "fixed" => (&disturbed, fixed.clone()),
            "matched" => (&matched(&disturbed)?, fixed.clone()),
            "refined" => (&matched(&disturbed)?, refine(&settings)),
            "cameras" => {
                matched(&disturbed)?;
                continue;
            }
            _ => return Err("fits: expected some of true, true-refined, fixed, matched, refined, cameras".into()),
        };
        println!("{fit:>12}: {}", capture.fit(&truth, settings)?);
    }
    Ok(())
}

fn view(photo: &Photo, located: bool) -> View<'_> {
    View { located, ..View::new(photo.camera, &photo.rgb, photo.mask.as_deref()) }
}

struct Disturbance {
    angle: f64,
    distance: f64,
    focal: f64,
}

#[derive(Clone)]
struct Capture {
    training: Vec<Photo>,
    held_out: Vec<Photo>,
    points: PointCloud,
}

impl Capture {
    fn load(folder: &str) -> Outcome<Self> {
        let capture = posed::load(folder, &PosedOptions::default())?;
        let (mut training, mut held_out) = (Vec::new(), Vec::new());
        for p in capture.photos {
            if p.held_out { held_out.push(p.photo) } else { training.push(p.photo) }
        }
        Ok(Self { training, held_out, points: capture.points })
    }

    fn disturbed(&self, by: &Disturbance, stream: Stream) -> Self {
        let mut other = self.clone();
        for (i, photo) in other.training.iter_mut().chain(&mut other.held_out).enumerate() {
            let distance = by.distance * self.distance(&photo.camera);
            let draws = stream.fork(i as u64);
            let camera = &mut photo.camera;
            let turn = so3::exp(direction(draws.fork(0)) * by.angle) * camera.pose.rotation;
            let center = camera.pose.center() + direction(draws.fork(1)) * distance;
            camera.pose = Pose::new(turn, -(turn * center));
            camera.intrinsics.fx *= by.focal;
            camera.intrinsics.fy *= by.focal;
        }
        let draws = stream.fork(u64::MAX);
        for (n, position) in other.points.positions.iter_mut().enumerate() {
            let point = DVec3::from(position.map(f64::from));
            let sees = |i: &usize| pixel(&self.training[*i].camera, point).is_some();
            let seeing: Vec<usize> = (0..self.training.len()).filter(sees).collect();
            if seeing.is_empty() {
                continue;
            }
            let i = seeing[draws.below(n as u64, seeing.len())];
            if let Some((pixel, depth)) = pixel(&self.training[i].camera, point) {
                *position = other.training[i].camera.unproject(pixel, depth).as_vec3().to_array();
            }
        }
        other
    }

    fn matched(&self, focal: bool) -> (Self, Refined) {
        let views: Vec<View<'_>> =
            (self.training.iter().map(|p| view(p, false))).chain(self.held_out.iter().map(|p| view(p, true))).collect();
        let found = weaver_sfm::refine(&views, &RefineSettings { focal, ..RefineSettings::default() });
        let mut other = self.clone();
        let photos = other.training.iter_mut().chain(&mut other.held_out);
        photos.zip(&found.cameras).for_each(|(photo, camera)| photo.camera = *camera);
        let cameras = |capture: &Self| capture.training.iter().map(|photo| photo.camera).collect::<Vec<_>>();
        let (before, after) = (cameras(self), cameras(&other));
        for position in &mut other.points.positions {
            *position = carried(DVec3::from(position.map(f64::from)), &before, &after).as_vec3().to_array();
        }
        (other, found)
    }

    /// The median depth of points that a camera sees.
    fn distance(&self, camera: &Camera) -> f64 {
        let points = self.points.positions.iter().map(|p| DVec3::from(p.map(f64::from)));
        if self.points.is_empty() {
            // Scenes made by a program stand around the origin.
            return camera.pose.center().length();
        }
        median(points.filter_map(|point| pixel(camera, point)).map(|(_, depth)| depth).collect())
    }

    /// Fits, and says how well the result meets held-out photos and the true cameras.
    fn fit(&self, truth: &Self, settings: FitSettings) -> Outcome<String> {
        let initial = match self.points.is_empty() {
            true => init::random(&self.training, &settings)?,
            false => init::from_points(&self.points, &settings)?,
        };
        let refine = settings.poses.refine;
        let mut fit = Fit::new(self.training.clone(), &initial, settings)?;
        let start = Instant::now();
        while fit.steps_done() < fit.settings().steps {
            fit.step()?;
        }
        let seconds = start.elapsed().as_secs_f64();
        let cameras: Vec<Camera> = (0..fit.photos()).map(|i| fit.camera(i)).collect();
        let [degrees, percent] = truth.errors(&cameras)?;
        let focal = 100.0 * (cameras[0].intrinsics.fx / truth.training[0].camera.intrinsics.fx - 1.0);
        let poses = |photos: &[Photo]| photos.iter().map(|photo| photo.camera.pose).collect::<Vec<_>>();
        let refined: Vec<Pose> = cameras.iter().map(|camera| camera.pose).collect();
        let onto = |from: &[Photo]| Similarity::fit_poses(&poses(from), &refined).ok_or("cameras on a line");
        let (from_given, from_true) = (onto(&self.training)?, onto(&truth.training)?);
        let (mut given, mut located) = (0.0, 0.0);
        for (photo, true_photo) in self.held_out.iter().zip(&truth.held_out) {
            let psnr = |fit: &mut Fit, camera: &Camera| -> Outcome<f64> {
                let image = fit.render(camera)?;
                Ok(Judge::default().compare(&image, &photo.rgb, [camera.height, camera.width]).psnr)
            };
            let carried = |by: &Similarity, camera: &Camera| Camera { pose: by.apply_to_pose(&camera.pose), ..*camera };
            let true_camera = Camera { intrinsics: photo.camera.intrinsics, ..true_photo.camera };
            given += psnr(&mut fit, &carried(&from_true, &true_camera))? / self.held_out.len() as f64;
            let start = carried(&from_given, &photo.camera);
            let found = if refine { fit.locate(photo, start, LOCATE)? } else { start };
            located += psnr(&mut fit, &found)? / self.held_out.len() as f64;
        }
        Ok(format!(
            "{degrees:.3} degrees, {percent:.3} % of the distance, focal {focal:+.2} %; held out {given:.2} dB at true cameras, {located:.2} dB {}; {seconds:.0} s",
            if refine { "located" } else { "at given ones" }
        ))
    }

    /// Median errors of cameras for the training photos: degrees, percent of the distance.
    fn errors(&self, cameras: &[Camera]) -> Outcome<[f64; 2]> {
        let found: Vec<Pose> = cameras.iter().map(|camera| camera.pose).collect();
        let truth: Vec<Pose> = self.training.iter().map(|photo| photo.camera.pose).collect();
        let onto = Similarity::fit_poses(&found, &truth).ok_or("cameras on a line")?;
        let pairs = || found.iter().map(|pose| onto.apply_to_pose(pose)).zip(&truth);
        let degrees = pairs().map(|(a, b)| a.angle_to(b).to_degrees()).collect();
        let percent = (pairs().zip(&self.training))
            .map(|((a, b), photo)| 100.0 * a.center().distance(b.center()) / self.distance(&photo.camera))
            .collect();
        Ok([median(degrees), median(percent)])
    }
}

/// Where a camera sees a point, and its depth; `None` if it does not.
fn pixel(camera: &Camera, point: DVec3) -> Option<(DVec2, f64)> {
    let p = camera.pose.apply(point);
    let at = camera.intrinsics.project(p);
    let inside = (0.0..camera.width as f64).contains(&at.x) && (0.0..camera.height as f64).contains(&at.y);
    (p.z > 0.0 && inside).then_some((at, p.z))
}

/// A direction, all equally likely.
fn direction(stream: Stream) -> DVec3 {
    DVec3::new(stream.normal(0), stream.normal(1), stream.normal(2)).normalize_or(DVec3::X)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Lays one JSON tree over another.
fn merge(base: &mut serde_json::Value, over: serde_json::Value) {
    match (base, over) {
        (serde_json::Value::Object(base), serde_json::Value::Object(over)) => {
            over.into_iter().for_each(|(key, value)| merge(base.entry(key).or_insert(serde_json::Value::Null), value));
        }
        (base, over) => *base = over,
    }
}
