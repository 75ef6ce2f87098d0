//! `splatweaver convert`.

mod cameras;
mod contribution;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use contribution::contributions;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use weaver_command::{Console, ConsoleObserver, Failure, Output};
use weaver_geometry::Similarity;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_io::{Conversion, ConvertError, Converted, Keep, Loss, SCENE_FORMATS, SceneFormat, Score, convert};
use weaver_scene::{Difference, Gaussians, Region};

/// Writes files of Gaussians in another format, or cameras; the names of files select the formats.
///
/// Cameras of Metashape (XML), RealityScan (CSV), Bundler, OpenSfM, COLMAP or a transforms.json become a transforms.json, by that name, or
/// a folder with one and a COLMAP model with points in sparse/0; --rotate, --scale and --translate move them. Of scenes, several inputs are joined. What is asked for happens in this order: --rotate, --scale, --translate, --crop, --drop-floaters, --keep,
/// --degree.
#[derive(Args, Debug)]
#[command(after_help = after_help(), override_usage = "splatweaver convert [OPTIONS] <IN>... <OUT>")]
pub struct Convert {
    /// The files to read; or one file or folder of cameras
    #[arg(value_name = "IN", num_args = 1.., required = true)]
    pub from: Vec<PathBuf>,
    /// The file to write, or the folder for cameras
    #[arg(value_name = "OUT", required = true, value_parser = Output::file_or_folder(&[]))]
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
    pub by: ScoreName,
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
    /// Checks that no flag is given that cameras have no use for.
    fn check_cameras(&self) -> Result<(), Failure> {
        let Self { crop, drop_floaters, keep, cameras, degree, .. } = self;
        if crop.is_some() || *drop_floaters || keep.is_some() || cameras.is_some() || degree.is_some() {
            let flags = "--crop, --drop-floaters, --keep, --cameras, --degree";
            return Err(Failure::Usage(format!("{flags}: expected Gaussians, found cameras")));
        }
        Ok(())
    }

    /// The movement of all Gaussians, if there is any.
    fn movement(&self) -> Option<Similarity> {
        let Self { rotate, scale, translate, .. } = self;
        (rotate.is_some() || scale.is_some() || translate.is_some()).then(|| {
            let Triple([x, y, z]) = rotate.unwrap_or(Triple([0.0; 3]));
            let [x, y, z] = [x, y, z].map(f64::to_radians);
            Similarity {
                scale: scale.unwrap_or(1.0),
                rotation: DMat3::from_rotation_z(z) * DMat3::from_rotation_y(y) * DMat3::from_rotation_x(x),
                translation: translate.map_or(DVec3::ZERO, |Triple(by)| DVec3::from(by)),
            }
        })
    }
}

/// A score that Gaussians are judged by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum ScoreName {
    /// Opacity times the area seen from the broadest side
    #[default]
    Importance,
    /// Opacity alone
    Opacity,
    /// Weights in the pictures of --cameras, summed over all pixels
    Contribution,
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
        "convert cameras.xml capture",
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
    if let [one] = from.as_slice()
        && cameras::is_cameras(one)
    {
        arguments.check_cameras()?;
        return cameras::convert(one, to, arguments.movement(), arguments.json, console);
    }
    // A folder is for cameras.
    weaver_io::check_output_file(to, from)?;
    let contribution = |gaussians: &Gaussians, drawing| {
        let cameras = arguments.cameras.as_deref().expect("clap requires cameras for this score");
        contributions(gaussians, cameras, (&from[0], drawing)).map_err(|failure| match failure {
            Failure::Error(error) => error,
            other => other.line().unwrap_or_default().into(),
        })
    };
    let conversion = Conversion {
        moved: arguments.movement(),
        crop: arguments.crop,
        drop_floaters: arguments.drop_floaters,
        keep: arguments.keep,
        by: match arguments.by {
            ScoreName::Importance => Score::Importance,
            ScoreName::Opacity => Score::Opacity,
            ScoreName::Contribution => Score::Of(&contribution),
        },
        degree: arguments.degree.map(usize::from),
    };
    let written = match convert(from, to, &conversion, &mut ConsoleObserver::new(console)) {
        Err(error @ ConvertError::Nothing { .. }) => return Err(Failure::message(format!("--{error}"))),
        Err(ConvertError::Score(error)) => return Err(Failure::Error(error)),
        converted => converted?,
    };
    if arguments.json {
        return console.print(&serde_json::to_string_pretty(&json(&written, from, to))?);
    }
    if written.gaussians != written.read {
        console.note(&format!("{} of {} Gaussians stay", written.gaussians, written.read));
    }
    console.print(&text(&written, to))
}

fn text(written: &Converted, to: &Path) -> String {
    let Converted { format, gaussians, bytes, loss, .. } = written;
    let mut text = format!("{gaussians} Gaussians, {:.1} MB, {}: {}", *bytes as f64 / 1e6, format.keeps, to.display());
    if let Some(Loss { difference: Difference { position, color }, left_out }) = loss {
        let harmonics = left_out.map_or(String::new(), |degree| format!("; no harmonics beyond degree {degree}"));
        text += &format!(
            "\noff by (mean, largest): positions {:.2e}, {:.2e}; colors {:.4}, {:.4}{harmonics}",
            position.mean, position.largest, color.mean, color.largest
        );
    }
    text
}

fn json(written: &Converted, from: &[PathBuf], to: &Path) -> Value {
    let path = |path: &Path| path.display().to_string();
    let mut report = json!({
        "inputs": from.iter().map(|file| path(file)).collect::<Vec<_>>(),
        "output": path(to),
        "format": written.format.name,
        "read": written.read,
        "gaussians": written.gaussians,
        "bytes": written.bytes,
    });
    if let Some(Loss { difference: Difference { position, color }, left_out }) = &written.loss {
        report["position"] = json!({ "mean": position.mean, "largest": position.largest });
        report["color"] = json!({ "mean": color.mean, "largest": color.largest });
        report["degree"] = json!(left_out);
    }
    report
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
