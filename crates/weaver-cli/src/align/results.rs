//! What an alignment leaves on disk, and prints.

use crate::cameras::stems;
use crate::failure::Failure;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use weaver_align::{Aligned, Outcome};
use weaver_data::posed::PosedPhoto;
use weaver_geometry::{Camera, Intrinsics};
use weaver_io::colmap::Model;
use weaver_io::{Image, Transforms};
use weaver_scene::Frame;
use weaver_trainer::AlignLoss;

/// A photo, and what was found.
pub struct Row<'a> {
    pub photo: &'a PosedPhoto,
    pub aligned: Aligned<f32>,
}

/// The results of some photos, in a folder.
pub struct Results {
    folder: PathBuf,
    frames: Vec<Frame>,
    images: Vec<Image>,
    loss: AlignLoss,
    rows: Vec<(String, [f64; 2], [f64; 2], String)>,
}

impl Results {
    pub fn create(folder: &Path, loss: AlignLoss) -> Result<Self, Failure> {
        weaver_io::create_folder(folder.join("renders"))?;
        weaver_io::create_folder(folder.join("sparse/0"))?;
        Ok(Self { folder: folder.to_path_buf(), frames: Vec::new(), images: Vec::new(), loss, rows: Vec::new() })
    }

    pub fn push(&mut self, Row { photo, aligned }: Row<'_>) -> Result<(), Failure> {
        let Camera { width, height, intrinsics, pose } = aligned.camera;
        // The photo on disk has a size and distortion of its own; its focal lengths change as those of the photo without.
        let (file, before) = (photo.file_camera, photo.camera.intrinsics);
        let Intrinsics { fx, fy, .. } = file.intrinsics;
        let (fx, fy) = (fx * intrinsics.fx / before.fx, fy * intrinsics.fy / before.fy);
        let camera = Camera { pose, intrinsics: Intrinsics { fx, fy, ..file.intrinsics }, ..file };
        let absolute = |path: &PathBuf| std::path::absolute(path).unwrap_or(path.clone());
        self.frames.push(Frame {
            distortion: photo.distortion,
            mask: photo.mask_file.as_ref().map(absolute),
            time: photo.time,
            number: photo.number,
            ..Frame::new(absolute(&photo.path).display().to_string(), camera)
        });
        let pixels = aligned.image.iter().map(|x| x.clamp(0.0, 1.0)).collect();
        self.images.push(Image { width, height, pixels });
        self.rows.push((photo.name.clone(), aligned.loss, aligned.moved, kept(aligned.outcome)));
        Ok(())
    }

    /// Writes everything, and returns the table.
    pub fn finish(self) -> Result<String, Failure> {
        for (image, stem) in self.images.iter().zip(stems(&self.frames)) {
            image.write_png(self.folder.join("renders").join(format!("{stem}.png")))?;
        }
        Model::from_frames(&self.frames).write_binary(self.folder.join("sparse/0"))?;
        let rows: Vec<Value> = self.rows.iter().map(report).collect();
        weaver_io::write_text(self.folder.join("align.json"), &serde_json::to_string_pretty(&rows)?)?;
        Transforms { frames: self.frames, ..Transforms::default() }.write(self.folder.join("transforms.json"))?;
        let width = self.rows.iter().map(|(name, ..)| name.chars().count()).max().unwrap_or(0).max("photo".len());
        let (unit, figure): (_, fn(f64) -> f64) = match self.loss {
            AlignLoss::MeanSquare => ("dB", decibels),
            AlignLoss::Photometric => ("loss", |loss| loss),
            AlignLoss::Similarity => ("SSIM", |loss| 1.0 - loss),
        };
        let unit = format!("{unit} before");
        let mut text = format!("{:<width$}  {unit:>11}   after  degrees  of the depth\n", "photo");
        for (name, loss, moved, kept) in &self.rows {
            let [before, after] = loss.map(figure);
            let [degrees, distance] = moved;
            let _ = writeln!(
                text,
                "{name:<width$}  {before:>11.3}  {after:>6.3}  {degrees:>7.3}  {distance:>12.4}  {kept}"
            );
        }
        Ok(format!("{text}cameras: {}", self.folder.join("transforms.json").display()))
    }
}

fn decibels(loss: f64) -> f64 {
    -10.0 * loss.max(1e-10).log10()
}

fn report((name, loss, moved, kept): &(String, [f64; 2], [f64; 2], String)) -> Value {
    let [degrees, distance] = moved;
    json!({ "photo": name, "loss": loss, "degrees": degrees, "distance_over_depth": distance, "outcome": kept })
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
