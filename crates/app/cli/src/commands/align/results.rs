//! What an alignment leaves on disk, and prints.

use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use weaver_command::Failure;
use weaver_command::camera_files::stems;
use weaver_data::posed::PosedPhoto;
use weaver_fit::align::{Aligned, Outcome};
use weaver_geometry::{Camera, Intrinsics};
use weaver_io::colmap::Model;
use weaver_io::{Image, OutputFolder, Transforms};
use weaver_scene::Frame;

const CAMERAS: &str = "transforms.json";
const REPORT: &str = "align.json";
const MODEL: &str = "sparse/0";

fn picture(stem: &str) -> String {
    format!("renders/{stem}.png")
}

/// A photo, and what was found.
pub struct Row<'a> {
    pub photo: &'a PosedPhoto,
    pub aligned: Aligned<f32>,
    /// From the guess, and from where it was found.
    pub psnr: [f64; 2],
}

/// A line of the table: one photo.
struct Line {
    name: String,
    psnr: [f64; 2],
    loss: [f64; 2],
    moved: [f64; 2],
    outcome: String,
}

/// The results of some photos, in a folder.
pub struct Results {
    out: OutputFolder,
    frames: Vec<Frame>,
    images: Vec<Image>,
    rows: Vec<Line>,
}

impl Results {
    /// Claims the folder of an alignment that reads these files.
    pub fn claim<'a>(folder: &Path, read: impl Iterator<Item = &'a PathBuf>) -> Result<Self, Failure> {
        let out = OutputFolder::claim(folder, "align", read)?;
        out.check([CAMERAS, REPORT])?;
        out.check(Model::FILES.map(|name| format!("{MODEL}/{name}")))?;
        Ok(Self { out, frames: Vec::new(), images: Vec::new(), rows: Vec::new() })
    }

    /// Checks that there is a place for the pictures of these photos.
    pub fn check(&self, photos: &[PosedPhoto]) -> Result<(), Failure> {
        let frame = |photo: &PosedPhoto| Frame::new(photo.frame.path.display().to_string(), photo.photo.camera);
        let frames: Vec<Frame> = photos.iter().map(frame).collect();
        Ok(self.out.check(stems(&frames).iter().map(|stem| picture(stem)))?)
    }

    pub fn push(&mut self, Row { photo, aligned, psnr }: Row<'_>) -> Result<(), Failure> {
        let Camera { width, height, intrinsics, pose } = aligned.camera;
        // The photo on disk has a size and distortion of its own; its focal lengths change as those of the photo without.
        let (file, before) = (photo.frame.camera, photo.photo.camera.intrinsics);
        let Intrinsics { fx, fy, .. } = file.intrinsics;
        let (fx, fy) = (fx * intrinsics.fx / before.fx, fy * intrinsics.fy / before.fy);
        let camera = Camera { pose, intrinsics: Intrinsics { fx, fy, ..file.intrinsics }, ..file };
        // Relative, so that results and photos can be moved together.
        let name = |path: &PathBuf| weaver_io::relative_path(self.out.path(), path);
        self.frames.push(Frame {
            distortion: photo.frame.distortion,
            mask: photo.frame.mask.as_ref().map(name).transpose()?.map(PathBuf::from),
            time: photo.frame.time,
            number: photo.frame.number,
            ..Frame::new(name(&photo.frame.path)?, camera)
        });
        let pixels = aligned.image.iter().map(|x| x.clamp(0.0, 1.0)).collect();
        self.images.push(Image { width, height, pixels });
        let Aligned { loss, moved, outcome, .. } = aligned;
        self.rows.push(Line { name: photo.photo.name.clone(), psnr, loss, moved, outcome: kept(outcome) });
        Ok(())
    }

    /// Writes everything, and returns the table, or the same as JSON.
    pub fn finish(self, json: bool) -> Result<String, Failure> {
        for (image, stem) in self.images.iter().zip(stems(&self.frames)) {
            image.write_png(self.out.file(picture(&stem))?)?;
        }
        Model::from_frames(&self.frames).write_binary(self.out.files(MODEL, Model::FILES)?)?;
        let rows: Vec<Value> = self.rows.iter().map(report).collect();
        let rows = serde_json::to_string_pretty(&rows)?;
        weaver_io::write_text(self.out.file(REPORT)?, &rows)?;
        Transforms { frames: self.frames, ..Transforms::default() }.write(self.out.file(CAMERAS)?)?;
        if json {
            return Ok(rows);
        }
        let width = self.rows.iter().map(|row| row.name.chars().count()).max().unwrap_or(0).max("photo".len());
        let mut text = format!("{:<width$}  dB before   after  degrees  of the depth\n", "photo");
        for Line { name, psnr: [before, after], moved: [degrees, distance], outcome, .. } in &self.rows {
            let _ = writeln!(
                text,
                "{name:<width$}  {before:>9.2}  {after:>6.2}  {degrees:>7.3}  {distance:>12.4}  {outcome}"
            );
        }
        Ok(format!("{text}cameras: {}", self.out.path().join(CAMERAS).display()))
    }
}

fn report(Line { name, psnr, loss, moved: [degrees, distance], outcome }: &Line) -> Value {
    json!({
        "photo": name,
        "psnr": psnr,
        "loss": loss,
        "degrees": degrees,
        "distance_over_depth": distance,
        "outcome": outcome,
    })
}

fn kept(outcome: Outcome) -> String {
    match outcome {
        Outcome::Found => "kept".into(),
        Outcome::Flat => "guess kept: the photo, or the scene under it, has one color".into(),
        Outcome::Unseen(0.0) => "failed: nothing seen".into(),
        Outcome::Unseen(share) => format!("failed: the scene covers {:.1} % of the photo", 100.0 * share),
        Outcome::NotBetter => "failed: no camera near the guess is better".into(),
    }
}
