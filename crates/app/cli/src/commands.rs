//! The commands: a file each, with the words that it takes and what it does, and a row of the table.

mod align;
mod cameras;
mod compare;
mod completions;
mod compress;
mod config;
mod convert;
mod convert_weights;
mod dynamic;
mod eval;
mod fit;
mod infer;
mod info;
mod merge;
mod mesh;
mod plan;
mod reconstruct;
mod render;
mod split;
mod train;
mod view;

use crate::flags::{CompleteFlag, IfComplete};
use clap::Subcommand;
use std::path::PathBuf;
use weaver_command::{Console, Failure, Interrupt};
use weaver_data::CamerasSummary;
use weaver_run::Folder;

/// Makes the commands of their table: the enum that clap parses into, the groups of the help, and the call.
macro_rules! table {
    ($($title:literal: { $($name:ident($arguments:ty) => $run:expr,)+ })+) => {
        /// One command.
        #[derive(Debug, Subcommand)]
        pub enum Command {
            $($($name($arguments),)+)+
        }

        /// Titles of the groups in the help, and how many commands are in each, in the commands' order.
        pub const GROUPS: &[(&str, usize)] = &[$(($title, [$(stringify!($name)),+].len())),+];

        impl Command {
            /// Does what the command says.
            pub fn run(&self, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
                match self {
                    $($(Self::$name(arguments) => call($run, arguments, console, interrupt),)+)+
                }
            }
        }
    };
}

/// A command as a unit of work.
pub struct Unit {
    /// Folder of the results.
    pub out: PathBuf,
    /// Files and folders that it reads.
    pub inputs: Vec<PathBuf>,
    /// The file in the folder that has what `--json` prints.
    pub figures: &'static str,
    /// Figures are to be printed.
    pub json: bool,
    /// The command that goes on with a fit which was begun in the folder, if it makes one.
    pub resume: Option<Command>,
}

impl Command {
    /// The command as a unit of work, if it is to be one.
    ///
    /// # Errors
    /// When it has no folder of its own.
    pub fn unit(&self) -> Result<Option<Unit>, Failure> {
        let resumed = |out: &PathBuf, json, threads| {
            Some(Self::Fit(fit::Fit { resume: Some(out.clone()), json, threads, ..fit::Fit::default() }))
        };
        let unit = |complete: &CompleteFlag, out: &PathBuf, inputs: Vec<PathBuf>, (figures, json), resume| {
            complete.if_complete.map(|IfComplete::Skip| Unit { out: out.clone(), inputs, figures, json, resume })
        };
        Ok(match self {
            Self::Reconstruct(it) => {
                let resume = resumed(&it.out, it.json, it.threads.threads);
                unit(&it.complete, &it.out, it.photos.clone(), (Folder::SUMMARY, it.json), resume)
            }
            Self::Cameras(it) => unit(&it.complete, &it.out, it.photos.clone(), (CamerasSummary::NAME, it.json), None),
            Self::Infer(it) => unit(&it.complete, &it.out, it.read(), (infer::FIGURES, it.json), None),
            Self::Fit(it) if it.complete.if_complete.is_some() => {
                let out =
                    it.out.as_ref().ok_or_else(|| Failure::Usage("--if-complete: expected --out with it".into()))?;
                let resume = resumed(out, it.json, it.threads);
                unit(&it.complete, out, it.read(), (Folder::SUMMARY, it.json), resume)
            }
            _ => None,
        })
    }
}

/// Calls what a row names; this signature tells its types.
fn call<A>(
    run: impl FnOnce(&A, &mut Console, &Interrupt) -> Result<(), Failure>,
    arguments: &A,
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    run(arguments, console, interrupt)
}

table! {
    "Reconstruct": {
        Reconstruct(reconstruct::Reconstruct) => reconstruct::run,
        Cameras(cameras::Cameras) => |it, console, _| cameras::run(it, console),
        Fit(fit::Fit) => fit::run,
        Infer(infer::Infer) => infer::run,
        Split(split::Split) => |it, console, _| split::run(it, console),
        Merge(merge::Merge) => |it, console, _| merge::run(it, console),
        Plan(plan::Plan) => |it, console, _| plan::run(it, console),
    }
    "Look": {
        View(view::View) => view::run,
        Render(render::Render) => |it, console, _| render::run(it, console),
        Compare(compare::Compare) => |it, console, _| compare::run(it, console),
        Info(info::Info) => |it, console, _| info::run(it, console),
        Compress(compress::Compress) => |it, console, _| compress::run(it, console),
        Convert(convert::Convert) => |it, console, _| convert::run(it, console),
    }
    "Learn": {
        Train(train::Train) => train::run,
        Eval(eval::Eval) => |it, console, _| eval::run(it, console),
        Config(config::Config) => |it, console, _| config::run(it, console),
        ConvertWeights(convert_weights::ConvertWeights) => convert_weights::run,
    }
    "More": {
        Align(align::Align) => |it, console, _| align::run(it, console),
        Lift(weaver_lift_run::Lift) => |it, console, _| weaver_lift_run::lift(it, console),
        Query(weaver_lift_run::Query) => |it, console, _| weaver_lift_run::query(it, console),
        Dynamic(dynamic::Dynamic) => dynamic::run,
        Vad(weaver_vad_run::Vad) => weaver_vad_run::run,
        Lidar(weaver_lidar_run::Lidar) => weaver_lidar_run::run,
        Mesh(mesh::Meshing) => |it, console, _| mesh::run(it, console),
        EvalTrajectory(weaver_lidar_run::EvalTrajectory) => |it, console, _| weaver_lidar_run::eval_trajectory(it, console),
        EvalMesh(weaver_lidar_run::EvalMesh) => |it, console, _| weaver_lidar_run::eval_mesh(it, console),
        Image(weaver_image_run::Pictures) => weaver_image_run::run,
        Bench(weaver_bench::Bench) => weaver_bench::run,
        Completions(completions::Completions) => |it, console, _| completions::run(it, console),
    }
}
