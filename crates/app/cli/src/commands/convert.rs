//! `splatweaver convert`.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use serde_json::json;
use std::cell::Cell;
use std::path::{Path, PathBuf};
use weaver_command::{Console, ConsoleObserver, DrawingOptions, Failure, Output, positive};
use weaver_geometry::Similarity;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_io::{Conversion, ConvertError, ConvertedCameras, Keep, SCENE_FORMATS, SceneFormat, Score};
use weaver_io::{Observe, convert, convert_cameras, is_cameras};
use weaver_reconstruct::{Outcome, clean};
use weaver_scene::{Gaussians, Region};

/// Writes files of Gaussians in another format, or cameras; the names of files select the formats.
///
/// Cameras of Metashape (XML), RealityScan (CSV), Bundler, OpenSfM, COLMAP or a transforms.json become a
/// transforms.json, by that name, or a folder with one and a COLMAP model with points in sparse/0; --rotate, --scale
/// and --translate move them. Of scenes, several inputs are joined. Changes happen in this order: --clean, --rotate,
/// --scale, --translate, --crop, --drop-floaters, --keep, --merge, --degree.
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
    #[arg(long, value_name = "FACTOR", value_parser = positive())]
    pub scale: Option<f64>,
    /// Moves, world units
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, allow_hyphen_values = true)]
    pub translate: Option<Triple>,
    /// Keeps Gaussians with their center in a box (X,Y,Z,X,Y,Z: two corners) or a sphere (X,Y,Z,RADIUS)
    #[arg(long, value_name = "BOX|SPHERE", allow_hyphen_values = true)]
    pub crop: Option<Region>,
    /// Leaves out what the photos of --cameras do not need; without them, what cannot show or is far from all others
    #[arg(long)]
    pub clean: bool,
    /// Leaves out Gaussians that are unusually far from all others
    #[arg(long)]
    pub drop_floaters: bool,
    /// Number of Gaussians that stay, or their share below 1
    #[arg(long, value_name = "N|SHARE")]
    pub keep: Option<Keep>,
    /// Merges neighbors until so many Gaussians are left, or their share below 1
    #[arg(long, value_name = "N|SHARE")]
    pub merge: Option<Keep>,
    /// The score that they are judged by
    #[arg(long, value_enum, value_name = "SCORE", default_value_t, requires = "keep")]
    pub by: ScoreName,
    /// Cameras of the scene as it is read, for --clean and --by contribution: transforms.json, a folder with a COLMAP
    /// model, or a RealEstate10K file
    #[arg(long, value_name = "FILE", required_if_eq("by", "contribution"), conflicts_with_all = ["rotate", "scale", "translate"])]
    pub cameras: Option<PathBuf>,
    /// Largest degree of spherical harmonics that stays
    #[arg(long, value_name = "0..4", value_parser = clap::value_parser!(u8).range(0..=4))]
    pub degree: Option<u8>,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
}

impl Convert {
    /// Checks that no flag is given that cameras have no use for.
    fn check_cameras(&self) -> Result<(), Failure> {
        let Self { clean, crop, drop_floaters, keep, merge, cameras, degree, .. } = self;
        let chosen = crop.is_some() || keep.is_some() || merge.is_some();
        if chosen || *clean || *drop_floaters || cameras.is_some() || degree.is_some() {
            let flags = "--clean, --crop, --drop-floaters, --keep, --merge, --cameras, --degree";
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

fn triple(text: &str) -> Result<Triple, String> {
    let numbers = text.split(',').map(|part| part.trim().parse().ok().filter(|x: &f64| x.is_finite()));
    let three = numbers.collect::<Option<Vec<f64>>>().and_then(|numbers| numbers.try_into().ok());
    three.map(Triple).ok_or_else(|| "expected three numbers, as in 0,0,90".into())
}

fn after_help() -> String {
    let rows = SCENE_FORMATS.iter().map(|f| format!("  {:<11} {:<16} {}", f.name, f.file_name_end(), f.keeps));
    let formats = rows.collect::<Vec<_>>().join("\n");
    let examples = [
        "convert scene.ply scene.spz",
        "convert scene.ply scene.sog --degree 1 --keep 500000",
        "convert scene.ply small.ply --keep 0.3 --by contribution --cameras transforms.json",
        "convert scene.ply scene-levels/lod-meta.json",
        "convert cameras.xml capture",
        "convert left.ply right.spz both.glb",
        "convert scene.ply turned.ply --rotate 180,0,0 --crop -2,-2,-2,2,2,2 --drop-floaters",
    ];
    let examples = examples.map(|example| format!("  splatweaver {example}")).join("\n");
    format!("Formats, and what they keep:\n{formats}\n\nExamples:\n{examples}")
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
        && is_cameras(one)
    {
        return convert_one(one, arguments, console);
    }
    // A folder is for cameras.
    weaver_io::check_output_file(to, from)?;
    if arguments.cameras.is_some() && !arguments.clean && !matches!(arguments.by, ScoreName::Contribution) {
        return Err(Failure::Usage("--cameras: expected --clean or --by contribution with it".into()));
    }
    let contribution = |gaussians: &Gaussians, drawing| {
        let cameras = arguments.cameras.as_deref().expect("clap requires cameras for this score");
        DrawingOptions::default().contributions(gaussians, cameras, (&from[0], drawing)).map_err(Failure::into_error)
    };
    let removed = Cell::new(None);
    let clean = |gaussians: Gaussians, drawing, observe: &mut dyn Observe| {
        let Some(capture) = &arguments.cameras else {
            let visible = gaussians.select(&gaussians.visible());
            return Ok(visible.select(&visible.without_floaters()));
        };
        let drawn = DrawingOptions::default().beside(&from[0], drawing).map_err(Failure::into_error)?;
        let (left, cleaned) = clean(&gaussians, capture, drawn, Outcome::beside(&from[0]).as_ref(), observe)?;
        removed.set(Some(cleaned));
        Ok(left)
    };
    let conversion = Conversion {
        clean: arguments.clean.then_some(&clean),
        moved: arguments.movement(),
        crop: arguments.crop,
        drop_floaters: arguments.drop_floaters,
        keep: arguments.keep,
        merge: arguments.merge,
        by: match arguments.by {
            ScoreName::Importance => Score::Importance,
            ScoreName::Opacity => Score::Opacity,
            ScoreName::Contribution => Score::Of(&contribution),
        },
        degree: arguments.degree.map(usize::from),
    };
    let written = match convert(from, to, &conversion, &mut ConsoleObserver::new(console)) {
        Err(error @ ConvertError::Nothing { .. }) => return Err(Failure::message(format!("--{error}"))),
        Err(ConvertError::Caller(error)) => return Err(Failure::Error(error)),
        converted => converted?,
    };
    let mut answer = written.json(from, to);
    if let Some(cleaned) = removed.get() {
        console.note(&cleaned.to_string());
        answer["cleaned"] = json!(cleaned);
    }
    if written.gaussians != written.read {
        console.note(&format!("{} of {} Gaussians stay", written.gaussians, written.read));
    }
    console.answer(arguments.json, &[to], answer, &written.text(to))
}

/// Converts cameras.
fn convert_one(from: &Path, arguments: &Convert, console: &mut Console) -> Result<(), Failure> {
    arguments.check_cameras()?;
    let to = &arguments.to;
    let converted = convert_cameras(from, to, arguments.movement(), &mut ConsoleObserver::new(console))?;
    let ConvertedCameras { photos, points, .. } = &converted;
    let text = format!("cameras of {photos} photos, {points} points: {}", to.display());
    console.answer(arguments.json, &[to], converted.json(from, to), &text)
}
