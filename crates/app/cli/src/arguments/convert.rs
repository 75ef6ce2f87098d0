//! The command line of `splatweaver convert`.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use weaver_io::{SCENE_FORMATS, SceneFormat};
use weaver_scene::Region;

/// Writes files of Gaussians in another format; the names of files select the formats.
///
/// Several inputs are joined. What is asked for happens in this order: --rotate, --scale, --translate, --crop, --drop-floaters, --keep,
/// --degree.
#[derive(Args, Debug)]
#[command(after_help = after_help(), override_usage = "splatweaver convert [OPTIONS] <IN>... <OUT>")]
pub struct Convert {
    /// The files to read, and last the file to write
    #[arg(value_name = "IN.. OUT", num_args = 2.., required = true)]
    pub files: Vec<PathBuf>,
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
    /// How many Gaussians stay, or which share of them below 1
    #[arg(long, value_name = "N|SHARE", value_parser = keep)]
    pub keep: Option<Keep>,
    /// What they are judged by
    #[arg(long, value_enum, value_name = "SCORE", default_value_t, requires = "keep")]
    pub by: Score,
    /// Largest degree of spherical harmonics that stays
    #[arg(long, value_name = "0..4", value_parser = clap::value_parser!(u8).range(0..=4))]
    pub degree: Option<u8>,
    /// Prints what was done as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
}

impl Convert {
    /// The files that are read, and the one that is written.
    pub fn inputs_and_output(&self) -> (&[PathBuf], &PathBuf) {
        let (to, from) = self.files.split_last().expect("the command line has at least two");
        (from, to)
    }
}

/// What Gaussians are judged by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Score {
    /// Opacity times the area seen from the broadest side
    #[default]
    Importance,
    /// Opacity alone
    Opacity,
}

/// How many Gaussians stay.
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
    if let Ok(count) = text.parse() {
        return Ok(Keep::Count(count));
    }
    let share = text.parse().ok().filter(|share| (0.0..=1.0).contains(share));
    share.map(Keep::Share).ok_or_else(|| "expected a number of Gaussians, or a share from 0.0 to 1.0".into())
}

fn after_help() -> String {
    let rows = SCENE_FORMATS.iter().map(|f| format!("  {:<11} {:<16} {}", f.name, f.file_name_end(), f.keeps));
    let formats: Vec<String> = rows.collect();
    let examples = [
        "convert scene.ply scene.spz",
        "convert scene.ply scene.sog --degree 1 --keep 500000",
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
        for wrong in ["", "-1", "1.5", "nan", "half"] {
            assert!(keep(wrong).is_err(), "{wrong}");
        }
        assert_eq!(triple("0,-1.5,90"), Ok(Triple([0.0, -1.5, 90.0])));
        assert!(triple("1,2").is_err() && triple("1,2,inf").is_err() && factor("0").is_err());
    }
}
