//! `splatweaver convert`.

use crate::arguments::{Convert, Keep, Score, Triple};
use serde_json::{Value, json};
use std::path::Path;
use weaver_command::{Console, Failure};
use weaver_geometry::Similarity;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_io::{Drawing, SceneFormat, check_output_file, read_gaussians, read_scene, scene_bytes, write_scene};
use weaver_scene::{Difference, Gaussians, forms};

pub fn run(arguments: &Convert, console: &mut Console) -> Result<(), Failure> {
    let (from, to) = arguments.inputs_and_output();
    let format = SceneFormat::of(to)?;
    check_output_file(to, from)?;
    let (read, drawing) = joined(from, console)?;
    let count = read.len();
    let gaussians = edited(read, arguments);
    write_scene(to, &gaussians, drawing)?;
    let written =
        Written { format, gaussians: gaussians.len(), bytes: scene_bytes(to)?, loss: loss(to, format, &gaussians)? };
    if arguments.json {
        let report = written.json(from, to, count);
        return console.print(&serde_json::to_string_pretty(&report)?);
    }
    if gaussians.len() != count {
        console.note(&format!("{} of {count} Gaussians stay", gaussians.len()));
    }
    console.print(&written.text(to))
}

/// The Gaussians of all files, and how they are to be drawn if they agree on it.
fn joined(files: &[impl AsRef<Path>], console: &mut Console) -> Result<(Gaussians, Drawing), Failure> {
    let mut scenes = files.iter().map(read_scene).collect::<Result<Vec<_>, _>>()?;
    let drawing = scenes[0].drawing;
    if scenes.iter().any(|scene| scene.drawing != drawing) {
        console
            .note("warning: some inputs were trained antialiased and some were not; the result says nothing about it");
    }
    let agree = scenes.iter().all(|scene| scene.drawing == drawing);
    let drawing = if agree { drawing } else { Drawing::default() };
    if scenes.len() == 1 {
        return Ok((scenes.remove(0).gaussians, drawing));
    }
    let parts: Vec<Gaussians> = scenes.into_iter().map(|scene| scene.gaussians).collect();
    Ok((Gaussians::joined(&parts), drawing))
}

/// What the flags ask for, in the order that the help promises.
fn edited(mut gaussians: Gaussians, arguments: &Convert) -> Gaussians {
    let Convert { rotate, scale, translate, crop, drop_floaters, keep, by, degree, .. } = arguments;
    if rotate.is_some() || scale.is_some() || translate.is_some() {
        let Triple([x, y, z]) = rotate.unwrap_or(Triple([0.0; 3]));
        let [x, y, z] = [x, y, z].map(f64::to_radians);
        gaussians = gaussians.transformed(&Similarity {
            scale: scale.unwrap_or(1.0),
            rotation: DMat3::from_rotation_z(z) * DMat3::from_rotation_y(y) * DMat3::from_rotation_x(x),
            translation: translate.map_or(DVec3::ZERO, |Triple(by)| DVec3::from(by)),
        });
    }
    if let Some(region) = crop {
        gaussians = gaussians.select(&gaussians.inside(region));
    }
    if *drop_floaters {
        gaussians = gaussians.select(&gaussians.without_floaters());
    }
    if let Some(keep) = keep {
        let count = match keep {
            Keep::Count(count) => *count,
            Keep::Share(share) => (share * gaussians.len() as f64).round() as usize,
        };
        let values = match by {
            Score::Importance => gaussians.importance(),
            Score::Opacity => gaussians.opacity_logits.iter().map(|logit| forms::opacity(*logit)).collect(),
        };
        gaussians = gaussians.select(&gaussians.largest(&values, count));
    }
    match degree.map(usize::from) {
        Some(degree) if degree < gaussians.degree => gaussians.with_degree(degree),
        _ => gaussians,
    }
}

/// The difference that writing made, found by reading: none of a format that keeps every bit.
fn loss(to: &Path, format: SceneFormat, gaussians: &Gaussians) -> Result<Option<Loss>, Failure> {
    if format.name == "ply" {
        return Ok(None);
    }
    let back = read_gaussians(to)?;
    let difference = gaussians.select(&format.order(gaussians)).difference(&back);
    Ok(Some(Loss { difference, left_out: (gaussians.degree > back.degree).then_some(back.degree) }))
}

struct Loss {
    difference: Difference,
    /// The degree beyond which harmonics are gone.
    left_out: Option<usize>,
}

/// What was written.
struct Written {
    format: SceneFormat,
    gaussians: usize,
    bytes: u64,
    loss: Option<Loss>,
}

impl Written {
    fn text(&self, to: &Path) -> String {
        let Self { format, gaussians, bytes, loss } = self;
        let mut text =
            format!("{gaussians} Gaussians, {:.1} MB, {}: {}", *bytes as f64 / 1e6, format.keeps, to.display());
        if let Some(Loss { difference: Difference { position, color }, left_out }) = loss {
            let harmonics = left_out.map_or(String::new(), |degree| format!("; no harmonics beyond degree {degree}"));
            text += &format!(
                "\noff by (mean, largest): positions {:.2e}, {:.2e}; colors {:.4}, {:.4}{harmonics}",
                position.mean, position.largest, color.mean, color.largest
            );
        }
        text
    }

    fn json(&self, from: &[impl AsRef<Path>], to: &Path, read: usize) -> Value {
        let path = |path: &Path| path.display().to_string();
        let mut report = json!({
            "inputs": from.iter().map(|file| path(file.as_ref())).collect::<Vec<_>>(),
            "output": path(to),
            "format": self.format.name,
            "read": read,
            "gaussians": self.gaussians,
            "bytes": self.bytes,
        });
        if let Some(Loss { difference: Difference { position, color }, left_out }) = &self.loss {
            report["position"] = json!({ "mean": position.mean, "largest": position.largest });
            report["color"] = json!({ "mean": color.mean, "largest": color.largest });
            report["degree"] = json!(left_out);
        }
        report
    }
}
