//! The comparison as a job in steps: a step of training, or the end of a method with its evaluation.

use super::peers::{self, Peer};
use super::settings::Settings;
use super::table::{Coded, Row};
use super::views::{Views, views};
use crate::{CompressionError, METHODS, Point, Surface, Task, Training, formats};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;
use weaver_command::{DrawingOptions, Failure};
use weaver_compress::{Judge, Pictures};
use weaver_geometry::Camera;
use weaver_io::safetensors::Tensors;
use weaver_io::{Checksum, SCENE_FORMATS, SceneFile, atomic_write, read_scene};
use weaver_run::{Folder, Job, Kind, StepReport};
use weaver_scene::{Gaussians, Photo};
use weaver_splat::{RasterSettings, Renderer};

/// The folders of these runs.
pub const KIND: Kind = Kind { command: "bench compress", settings: "run.json", results: &[] };
/// Names in a checkpoint: finished rows, seconds of the method under way, and a file that is not written yet.
const ROWS: &str = "rows";
const SECONDS: &str = "seconds";
const FINISHED: &str = "finished";

/// Color behind a scene, and settings of drawing it.
type Drawing = ([f32; 3], RasterSettings);

struct Scene {
    path: PathBuf,
    gaussians: Gaussians,
    views: Views,
    drawing: Drawing,
}

/// All inputs of a comparison.
pub struct Inputs {
    settings: Settings,
    points: Vec<(&'static str, Point)>,
    peers: Vec<Peer>,
    scenes: Vec<Scene>,
}

fn pictures(cameras: &[Camera], (background, settings): Drawing) -> Pictures<'_> {
    Pictures { cameras, background, settings }
}

impl Inputs {
    /// Reads scenes and views. A resumed run fails if they have changed since its beginning.
    pub fn read(mut settings: Settings) -> Result<Self, Failure> {
        let points = points(&settings.methods)?;
        let peers = peers::read(&settings.peer, &settings.scenes)?;
        let mut scenes = Vec::new();
        for path in &settings.scenes {
            let SceneFile { gaussians, drawing } = read_scene(path)?;
            let drawing = DrawingOptions::default().beside(path, drawing)?;
            let views = views(&settings, &gaussians)?;
            scenes.push(Scene { path: path.clone(), gaussians, views, drawing });
        }
        let read: Vec<String> = scenes.iter().map(Scene::checksum).collect();
        if let Some((scene, _)) = scenes.iter().zip(read.iter().zip(&settings.read)).find(|(_, (a, b))| a != b) {
            let expected = "expected the scene and the views that the run began with, found others";
            return Err(Failure::message(format!("{}: {expected}", scene.path.display())));
        }
        settings.read = read;
        Ok(Self { settings, points, peers, scenes })
    }

    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Tasks of the scenes' methods.
    pub fn tasks(&self) -> Vec<Task<'_>> {
        let Settings { steps, seed, .. } = self.settings;
        let scenes = self.scenes.iter().map(|Scene { gaussians, views, drawing, .. }| {
            let pictures = pictures(&views.training, *drawing);
            Task { gaussians, pictures, photos: &views.photos[0], steps, seed }
        });
        scenes.collect()
    }

    /// The names of a run's files: one for each method and scene.
    ///
    /// # Errors
    /// When two would have one name.
    pub fn names(&self) -> Result<Vec<String>, Failure> {
        let mut names = BTreeSet::new();
        for scene in &self.scenes {
            for (method, point) in &self.points {
                let name = name(&scene.path, method, &point.setting);
                if !names.insert(name.clone()) {
                    let (path, found) = (scene.path.display(), "that of another scene");
                    return Err(Failure::message(format!("{path}: expected a name of its own, found {found}")));
                }
            }
        }
        Ok(names.into_iter().collect())
    }

    fn rows_of_scene(&self) -> usize {
        self.points.len() + self.peers.len()
    }
}

impl Scene {
    fn checksum(&self) -> String {
        let (mut sum, it) = (Checksum::default(), &self.gaussians);
        for floats in [it.means.as_flattened(), it.log_scales.as_flattened(), it.quats.as_flattened()] {
            sum.floats(floats);
        }
        sum.floats(&it.opacity_logits);
        sum.floats(&it.sh);
        self.views.add_to(&mut sum);
        sum.to_string()
    }
}

/// The name of a method's file: in its own format if other programs can read it.
fn name(scene: &Path, method: &str, setting: &str) -> String {
    let own = |c: char| c.is_ascii_alphanumeric() || c == '.';
    let setting = setting.split(|c| !own(c)).filter(|part| !part.is_empty());
    let words: Vec<&str> = std::iter::once(method).chain(setting).collect();
    let format = SCENE_FORMATS.iter().find(|format| format.name == method).map(|format| format.extension);
    let extension = format.unwrap_or(if method == "lite" { "wsz" } else { "bin" });
    format!("{}.{}.{extension}", scene.file_stem().unwrap_or_default().to_string_lossy(), words.join("-"))
}

/// The named methods, or all, with their constants.
fn points(asked: &[String]) -> Result<Vec<(&'static str, Point)>, Failure> {
    let families = METHODS.iter().flat_map(|family| (family.points)().into_iter().map(|point| (family.name, point)));
    let mut all: Vec<(&str, Point)> = formats().into_iter().chain(families).collect();
    if let Some(wrong) = asked.iter().find(|name| !all.iter().any(|(known, _)| *known == name.as_str())) {
        let mut names: Vec<&str> = all.iter().map(|(name, _)| *name).collect();
        names.dedup();
        return Err(Failure::Usage(format!("--methods: expected some of {}, found {wrong}", names.join(", "))));
    }
    let place = |name: &str| asked.iter().position(|other| other == name);
    if !asked.is_empty() {
        all.retain(|(name, _)| place(name).is_some());
        all.sort_by_key(|(name, _)| place(name));
    }
    Ok(all)
}

/// Views and surface for judging a scene.
struct Bench {
    judge: Judge,
    surface: Option<Surface>,
}

/// A comparison under way, with finished rows and at most one method in training.
pub struct Comparison<'a> {
    inputs: &'a Inputs,
    tasks: &'a [Task<'a>],
    rows: Vec<Row>,
    /// Judges of the scene of the next row.
    bench: Option<Bench>,
    /// The method under way, and its seconds so far.
    current: Option<(Box<dyn Training + 'a>, f64)>,
    /// The bytes of the last row, which are not written yet.
    finished: Option<Vec<u8>>,
}

impl<'a> Comparison<'a> {
    /// A comparison at its beginning, of the inputs' own tasks.
    pub fn new(inputs: &'a Inputs, tasks: &'a [Task<'a>]) -> Self {
        Self { inputs, tasks, rows: Vec::new(), bench: None, current: None, finished: None }
    }

    /// The finished rows.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Writes the file of a finished method.
    pub fn write(&mut self, folder: &Folder) -> Result<(), Failure> {
        if let (Some(bytes), Some(row)) = (&self.finished, self.rows.last()) {
            let name = name(Path::new(&row.scene), &row.coded.method, &row.coded.setting);
            atomic_write(folder.out().file(&name)?, |to| to.write_all(bytes))?;
        }
        self.finished = None;
        Ok(())
    }

    /// The scene of a row, and its index among the rows of the scene.
    fn place(&self, row: usize) -> [usize; 2] {
        let each = self.inputs.rows_of_scene();
        [row / each, row % each]
    }

    /// Steps of a row: its training, and one for the rest.
    fn steps_of(&self, row: usize) -> usize {
        let point = self.inputs.points.get(self.place(row)[1]);
        1 + point.map_or(0, |(_, point)| point.method.steps(self.inputs.settings.steps))
    }

    /// The training of the method of the next row, at its beginning.
    fn begin(&self) -> Result<Box<dyn Training + 'a>, CompressionError> {
        let [scene, place] = self.place(self.rows.len());
        self.inputs.points[place].1.method.begin(&self.tasks[scene])
    }

    /// Advances the next row; returns the loss.
    fn go_on(&mut self) -> Result<f64, CompressionError> {
        let [_, place] = self.place(self.rows.len());
        let Some((name, point)) = self.inputs.points.get(place) else {
            let peer = &self.inputs.peers[place - self.inputs.points.len()];
            self.judge(peer.result(), &peer.gaussians)?;
            return Ok(0.0);
        };
        let start = Instant::now();
        let (mut training, before) = match self.current.take() {
            Some(current) => current,
            None => (self.begin()?, 0.0),
        };
        let [done, of] = training.steps();
        if done < of {
            let loss = training.step()?;
            self.current = Some((training, before + start.elapsed().as_secs_f64()));
            return Ok(loss);
        }
        let bytes = training.finish()?;
        let (encoding, start) = (before + start.elapsed().as_secs_f64(), Instant::now());
        let decoded = point.method.decode(&bytes)?;
        let seconds = [Some(encoding), Some(start.elapsed().as_secs_f64())];
        let (method, setting) = (name.to_string(), point.setting.clone());
        self.judge(Coded { method, setting, bytes: bytes.len() as u64, seconds }, &decoded)?;
        self.finished = Some(bytes);
        Ok(0.0)
    }

    /// Adds the row of a method or a file, given its decoded Gaussians.
    fn judge(&mut self, coded: Coded, decoded: &Gaussians) -> Result<(), CompressionError> {
        let [number, place] = self.place(self.rows.len());
        let Scene { path, gaussians, views, drawing } = &self.inputs.scenes[number];
        let bench = match &mut self.bench {
            Some(bench) if place > 0 => bench,
            stale => stale.insert(Bench::new(gaussians, views, *drawing, self.inputs.settings.chamfer)?),
        };
        let held_out = &views.photos[1];
        let photos = (!held_out.is_empty()).then(|| psnr_of_photos(decoded, held_out, *drawing));
        self.rows.push(Row {
            scene: path.display().to_string(),
            gaussians: decoded.len(),
            // Bits per Gaussian of the original scene, before pruning.
            bits: 8.0 * coded.bytes as f64 / gaussians.len().max(1) as f64,
            psnr: bench.judge.psnr(decoded)?,
            photos: photos.transpose()?,
            chamfer: bench.surface.as_ref().map(|surface| surface.chamfer(decoded)).transpose()?,
            coded,
        });
        Ok(())
    }
}

impl Bench {
    fn new(gaussians: &Gaussians, views: &Views, drawing: Drawing, geometry: bool) -> Result<Self, CompressionError> {
        let all: Vec<Camera> = views.training.iter().chain(&views.judging).copied().collect();
        let surface = geometry.then(|| Surface::new(gaussians, &pictures(&all, drawing))).transpose()?;
        Ok(Self { judge: Judge::new(gaussians, &pictures(&views.judging, drawing))?, surface })
    }
}

/// Mean PSNR of a scene's pictures against photos from its cameras; NaN if a photo is masked altogether.
fn psnr_of_photos(
    gaussians: &Gaussians,
    photos: &[Photo],
    (background, settings): Drawing,
) -> Result<f64, CompressionError> {
    let (activated, mut renderer) = (gaussians.to_activated(), Renderer::default());
    let (judge, mut sum) = (weaver_fit::Judge::default(), 0.0);
    for photo in photos {
        let drawn = renderer.render(&activated, &[photo.camera], background, &settings)?.concat();
        sum += judge.compare_inside(&drawn, &photo.rgb, photo.size(), photo.mask.as_deref()).psnr;
    }
    Ok(sum / photos.len() as f64)
}

impl Job for Comparison<'_> {
    type Error = Failure;

    fn steps(&self) -> [usize; 2] {
        let under_way = self.current.as_ref().map_or(0, |(training, _)| training.steps()[0]);
        let sum = |rows: usize| (0..rows).map(|row| self.steps_of(row)).sum::<usize>();
        [sum(self.rows.len()) + under_way, sum(self.inputs.scenes.len() * self.inputs.rows_of_scene())]
    }

    fn step(&mut self) -> Result<StepReport, Failure> {
        let [scene, place] = self.place(self.rows.len());
        let path = self.inputs.scenes[scene].path.display();
        let stage = match self.inputs.points.get(place) {
            Some((name, point)) => format!("{name} {}", point.setting).trim_end().to_string(),
            None => self.inputs.peers[place - self.inputs.points.len()].name.clone(),
        };
        let loss = self.go_on().map_err(|error| Failure::message(format!("{path}: {stage}: {error}")))?;
        let [step, of] = self.steps();
        Ok(StepReport { step, of, stage, loss, ..StepReport::default() })
    }

    fn state(&mut self) -> Result<Tensors, Failure> {
        let mut state = Tensors::default();
        if let Some((training, seconds)) = &self.current {
            state = training.state();
            state.insert(SECONDS, &[1], vec![*seconds]);
        }
        state.metadata.insert(ROWS.into(), serde_json::to_string(&self.rows)?);
        if let Some(bytes) = &self.finished {
            state.insert(FINISHED, &[bytes.len()], bytes.clone());
        }
        Ok(state)
    }

    fn restore(&mut self, state: &Tensors) -> Result<(), Failure> {
        let other = |found: String| {
            let origin = state.origin().display();
            Failure::message(format!("{origin}: expected the state of this comparison, found {found}"))
        };
        let rows = state.metadata.get(ROWS).ok_or_else(|| other("no rows".into()))?;
        let rows: Vec<Row> = serde_json::from_str(rows).map_err(|error| other(error.to_string()))?;
        let all = self.inputs.scenes.len() * self.inputs.rows_of_scene();
        if rows.len() > all {
            return Err(other(format!("{} rows of {all}", rows.len())));
        }
        self.rows = rows;
        if let Ok(tensor) = state.get(FINISHED) {
            let shape = tensor.shape.clone();
            self.finished = Some(state.values::<u8>(FINISHED, &shape)?.to_vec());
        }
        if state.get(SECONDS).is_ok() {
            let seconds = state.values::<f64>(SECONDS, &[1])?[0];
            let [_, place] = self.place(self.rows.len());
            if self.rows.len() == all || place >= self.inputs.points.len() {
                return Err(other("training where there is none".into()));
            }
            let mut training = self.begin()?;
            training.restore(state)?;
            self.current = Some((training, seconds));
        }
        Ok(())
    }

    fn stepped(&mut self, folder: &Folder) -> Result<(), Failure> {
        self.write(folder)
    }
}
