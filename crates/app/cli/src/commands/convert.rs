//! `splatweaver convert`.

mod contribution;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use contribution::contributions;
use serde_json::{Value, json};
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure, Output};
use weaver_geometry::Similarity;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_io::{
    Blocks, Chained, Changed, Drawing, SCENE_FORMATS, SceneFormat, WrittenScene, open_scene, scene_bytes,
    write_blocks_checked,
};
use weaver_scene::{Difference, Gaussians, Region, forms};

/// Writes files of Gaussians in another format; the names of files select the formats.
///
/// Several inputs are joined. What is asked for happens in this order: --rotate, --scale, --translate, --crop, --drop-floaters, --keep,
/// --degree.
#[derive(Args, Debug)]
#[command(after_help = after_help(), override_usage = "splatweaver convert [OPTIONS] <IN>... <OUT>")]
pub struct Convert {
    /// The files to read
    #[arg(value_name = "IN", num_args = 1.., required = true)]
    pub from: Vec<PathBuf>,
    /// The file to write
    #[arg(value_name = "OUT", required = true, value_parser = Output::file(&[]))]
    pub to: Output,
    /// Turns by so many degrees about the axes x, then y, then z
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, allow_hyphen_values = true)]
    pub rotate: Option<Triple>,
    /// Multiplies all lengths
    #[arg(long, value_name = "FACTOR", value_parser = factor)]
    pub scale: Option<f64>,
    /// Moves, world units
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, allow_hyphen_values = true)]
    pub translate: Option<Triple>,
    /// Keeps what has its center in a box (X,Y,Z,X,Y,Z: two corners) or a sphere (X,Y,Z,RADIUS)
    #[arg(long, value_name = "BOX|SPHERE", value_parser = region, allow_hyphen_values = true)]
    pub crop: Option<Region>,
    /// Leaves out Gaussians that are unusually far from all others
    #[arg(long)]
    pub drop_floaters: bool,
    /// Number of Gaussians that stay, or their share below 1
    #[arg(long, value_name = "N|SHARE", value_parser = keep)]
    pub keep: Option<Keep>,
    /// The score that they are judged by
    #[arg(long, value_enum, value_name = "SCORE", default_value_t, requires = "keep")]
    pub by: Score,
    /// Cameras of the scene as it is read, for --by contribution: transforms.json, a folder with a COLMAP model, or a RealEstate10K file
    #[arg(long, value_name = "FILE", required_if_eq("by", "contribution"), requires = "keep", conflicts_with_all = ["rotate", "scale", "translate"])]
    pub cameras: Option<PathBuf>,
    /// Largest degree of spherical harmonics that stays
    #[arg(long, value_name = "0..4", value_parser = clap::value_parser!(u8).range(0..=4))]
    pub degree: Option<u8>,
    /// Prints what was done as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
}

impl Convert {
    /// True if what stays of a scene depends on more than each Gaussian alone, or their number is not known before.
    fn chooses(&self) -> bool {
        self.crop.is_some() || self.drop_floaters || self.keep.is_some()
    }
}

/// A score that Gaussians are judged by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Score {
    /// Opacity times the area seen from the broadest side
    #[default]
    Importance,
    /// Opacity alone
    Opacity,
    /// Weights in the pictures of --cameras, summed over all pixels
    Contribution,
}

/// Number of Gaussians that stay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Keep {
    /// So many, or all if there are fewer.
    Count(usize),
    /// This share of them.
    Share(f64),
}

/// Three numbers; a type of its own, for the command line takes lists apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triple(pub [f64; 3]);

fn numbers(text: &str) -> Option<Vec<f64>> {
    let numbers = text.split(',').map(|part| part.trim().parse().ok().filter(|x: &f64| x.is_finite()));
    numbers.collect()
}

fn triple(text: &str) -> Result<Triple, String> {
    let three = numbers(text).and_then(|numbers| numbers.try_into().ok());
    three.map(Triple).ok_or_else(|| "expected three numbers, as in 0,0,90".into())
}

fn factor(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|x| *x > 0.0 && f64::is_finite(*x)).ok_or_else(|| "expected a positive number".into())
}

fn region(text: &str) -> Result<Region, String> {
    let numbers: Option<Vec<f32>> = numbers(text).map(|numbers| numbers.into_iter().map(|x| x as f32).collect());
    match numbers.as_deref() {
        Some(&[a, b, c, d, e, f]) => {
            let corners = [[a, d], [b, e], [c, f]];
            Ok(Region::Box { min: corners.map(|[a, b]| a.min(b)), max: corners.map(|[a, b]| a.max(b)) })
        }
        Some(&[x, y, z, radius]) if radius >= 0.0 => Ok(Region::Sphere { center: [x, y, z], radius }),
        _ => Err("expected six numbers, the corners of a box, or four, the center and the radius of a sphere".into()),
    }
}

fn keep(text: &str) -> Result<Keep, String> {
    let count = text.parse().ok().map(Keep::Count);
    let share = text.parse().ok().filter(|share| (0.0..=1.0).contains(share)).map(Keep::Share);
    // Nothing is no scene.
    let some = count.or(share).filter(|keep| !matches!(keep, Keep::Count(0) | Keep::Share(0.0)));
    some.ok_or_else(|| "expected a number of Gaussians, or a share above 0.0 up to 1.0".into())
}

fn after_help() -> String {
    let rows = SCENE_FORMATS.iter().map(|f| format!("  {:<11} {:<16} {}", f.name, f.file_name_end(), f.keeps));
    let formats: Vec<String> = rows.collect();
    let examples = [
        "convert scene.ply scene.spz",
        "convert scene.ply scene.sog --degree 1 --keep 500000",
        "convert scene.ply small.ply --keep 0.3 --by contribution --cameras transforms.json",
        "convert left.ply right.spz both.glb",
        "convert scene.ply turned.ply --rotate 180,0,0 --crop -2,-2,-2,2,2,2 --drop-floaters",
    ];
    let examples = examples.map(|example| format!("  splatweaver {example}")).join("\n");
    format!("Formats, and what they keep:\n{}\n\nExamples:\n{examples}", formats.join("\n"))
}

/// The name of a format that is written to one file.
pub(super) fn scene_format() -> impl TypedValueParser<Value = SceneFormat> {
    let formats = SCENE_FORMATS.iter().filter(|format| format.writes_one_file());
    PossibleValuesParser::new(formats.map(|format| PossibleValue::new(format.name).help(format.keeps)))
        .map(|name| name.parse().expect("a name of the table"))
}

pub fn run(arguments: &Convert, console: &mut Console) -> Result<(), Failure> {
    let Convert { from, to, .. } = arguments;
    let format = SceneFormat::of(to)?;
    let (read, drawing) = joined(from, console)?;
    let count = read.len();
    let mut gaussians = turned(read, arguments);
    // Where each Gaussian goes its own way, the scene passes through in blocks.
    if arguments.chooses() || !format.writes_blocks() {
        gaussians = Box::new(chosen(gaussians.into_all()?, drawing, arguments)?);
    }
    if gaussians.is_empty() {
        console.note(&format!("warning: {}: a scene without Gaussians, as its inputs are", to.display()));
    }
    let loss = write_blocks_checked(to, &*gaussians, drawing, |written| loss(written, &*gaussians))?;
    let written = Written { format, gaussians: gaussians.len(), bytes: scene_bytes(to)?, loss };
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
fn joined(files: &[impl AsRef<Path>], console: &mut Console) -> Result<(Box<dyn Blocks>, Drawing), Failure> {
    let mut scenes = files.iter().map(open_scene).collect::<Result<Vec<_>, _>>()?;
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
    Ok((Box::new(Chained(scenes.into_iter().map(|scene| scene.gaussians).collect())), drawing))
}

/// The Gaussians after --rotate, --scale, --translate and --degree, which change each of them whatever the others are.
fn turned(gaussians: Box<dyn Blocks>, arguments: &Convert) -> Box<dyn Blocks> {
    let Convert { rotate, scale, translate, degree, .. } = arguments;
    let moved = (rotate.is_some() || scale.is_some() || translate.is_some()).then(|| {
        let Triple([x, y, z]) = rotate.unwrap_or(Triple([0.0; 3]));
        let [x, y, z] = [x, y, z].map(f64::to_radians);
        Similarity {
            scale: scale.unwrap_or(1.0),
            rotation: DMat3::from_rotation_z(z) * DMat3::from_rotation_y(y) * DMat3::from_rotation_x(x),
            translation: translate.map_or(DVec3::ZERO, |Triple(by)| DVec3::from(by)),
        }
    });
    let degree = degree.map_or(gaussians.degree(), |degree| gaussians.degree().min(degree.into()));
    if moved.is_none() && degree == gaussians.degree() {
        return gaussians;
    }
    let change = move |block: &Gaussians| match &moved {
        Some(moved) => block.transformed(moved).with_degree(degree),
        None => block.with_degree(degree),
    };
    Box::new(Changed { from: gaussians, degree, change: Box::new(change) })
}

/// Applies the flags that choose among all Gaussians, in the order that the help promises.
fn chosen(mut gaussians: Gaussians, drawing: Drawing, arguments: &Convert) -> Result<Gaussians, Failure> {
    let Convert { crop, drop_floaters, keep, by, .. } = arguments;
    let nothing = |flag: &str, expected: &str, before: &Gaussians| {
        let [min, max] = corners(before);
        let found = format!("none of {}, which lie from {min:?} to {max:?}", before.len());
        Failure::message(format!("{flag}: expected {expected}, found {found}"))
    };
    if let Some(region) = crop {
        let inside = gaussians.inside(region);
        if inside.is_empty() && !gaussians.is_empty() {
            return Err(nothing("--crop", "Gaussians in the region", &gaussians));
        }
        gaussians = gaussians.select(&inside);
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
            Score::Contribution => {
                let cameras = arguments.cameras.as_deref().expect("clap requires cameras for this score");
                contributions(&gaussians, cameras, (&arguments.from[0], drawing))?
            }
        };
        if count == 0 && !gaussians.is_empty() {
            return Err(nothing("--keep", "a share that leaves Gaussians", &gaussians));
        }
        gaussians = gaussians.select(&gaussians.largest(&values, count));
    }
    Ok(gaussians)
}

/// The corners of the box of all centers.
fn corners(gaussians: &Gaussians) -> [[f32; 3]; 2] {
    let side = |from: f32, choose: fn(f32, f32) -> f32| {
        std::array::from_fn(|axis| gaussians.means.iter().map(|mean| mean[axis]).fold(from, choose))
    };
    [side(f32::INFINITY, f32::min), side(f32::NEG_INFINITY, f32::max)]
}

/// The difference that writing made, found by reading: none of a format that keeps every bit.
fn loss(written: WrittenScene, gaussians: &dyn Blocks) -> Result<Option<Loss>, weaver_io::Error> {
    let WrittenScene { format, gaussians: back } = written;
    if format.is_exact() {
        return Ok(None);
    }
    let order = if format.writes_blocks() { None } else { Some(format.order(&*gaussians.all()?)) };
    let mut parts = Vec::new();
    for rows in back.blocks() {
        let before = match &order {
            Some(order) => Cow::Owned(gaussians.all()?.select(&order[rows.clone()])),
            None => gaussians.block(rows.clone())?,
        };
        parts.push((rows.len(), before.difference(&*back.block(rows)?)));
    }
    let difference = Difference::of_parts(parts);
    Ok(Some(Loss { difference, left_out: (gaussians.degree() > back.degree()).then_some(back.degree()) }))
}

struct Loss {
    difference: Difference,
    /// The degree beyond which harmonics are gone.
    left_out: Option<usize>,
}

/// A file that was written.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_are_boxes_or_spheres() {
        let ball = Region::Sphere { center: [-1.0, 0.0, 2.5], radius: 3.0 };
        let cube = Region::Box { min: [-1.0, 0.0, -3.0], max: [1.0, 2.0, 3.0] };
        assert_eq!((region("-1, 0,2.5,3"), region("1,0,-3,-1,2,3")), (Ok(ball), Ok(cube)));
        for wrong in ["", "1,2,3", "1,2,3,-1", "1,2,3,nan", "1,2,3,4,5", "a,b,c,d"] {
            assert!(region(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn what_stays_is_a_count_or_a_share() {
        assert_eq!((keep("1"), keep("0.25")), (Ok(Keep::Count(1)), Ok(Keep::Share(0.25))));
        assert_eq!(keep("1.0"), Ok(Keep::Share(1.0)));
        for wrong in ["", "-1", "1.5", "nan", "half", "0", "0.0"] {
            assert!(keep(wrong).is_err(), "{wrong}");
        }
        assert_eq!(triple("0,-1.5,90"), Ok(Triple([0.0, -1.5, 90.0])));
        assert!(triple("1,2").is_err() && triple("1,2,inf").is_err() && factor("0").is_err());
    }
}
