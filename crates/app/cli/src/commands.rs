//! The commands: a file each, with the words that it takes and what it does, and a row of the table.

mod align;
mod cameras;
mod compare;
mod completions;
mod compress;
mod config;
mod convert;
mod convert_weights;
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

use crate::flags::{CompleteFlag, EstimateFlags, IfComplete};
use crate::methods::Method;
use crate::table::table;
use clap::Subcommand;
use std::path::PathBuf;
use weaver_command::{Console, Failure, Interrupt, Output, in_pool};
use weaver_data::CamerasSummary;
use weaver_run::Folder;

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
        let resumed = |out: &Output, json, threads| {
            Some(Self::Fit(fit::Fit { resume: Some(out.to_path_buf()), json, threads, ..fit::Fit::default() }))
        };
        let unit = |complete: &CompleteFlag, out: &Output, inputs: Vec<PathBuf>, (figures, json), resume| {
            complete.if_complete.map(|IfComplete::Skip| Unit { out: out.to_path_buf(), inputs, figures, json, resume })
        };
        let read =
            |photos: &[PathBuf], estimate: &EstimateFlags| photos.iter().cloned().chain(estimate.files()).collect();
        Ok(match self {
            Self::Reconstruct(it) => {
                let resume = resumed(&it.out, it.json, it.threads.threads);
                unit(&it.complete, &it.out, read(&it.photos, &it.estimate), (Folder::SUMMARY, it.json), resume)
            }
            Self::Cameras(it) => {
                let figures = (CamerasSummary::NAME, it.json);
                unit(&it.complete, &it.out, read(&it.photos, &it.estimate), figures, None)
            }
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

table! {
    Command:
    "Reconstruct": {
        Reconstruct(reconstruct::Reconstruct) => |it, console, interrupt| in_pool(it.threads.count(), || reconstruct::run(it, console, interrupt)),
        Cameras(cameras::Cameras) => |it, console, _| in_pool(it.threads.count(), || cameras::run(it, console)),
        Fit(fit::Fit) => fit::run,
        Infer(infer::Infer) => |it, console, interrupt| in_pool(it.threads.count(), || infer::run(it, console, interrupt)),
        Split(split::Split) => |it, console, _| split::run(it, console),
        Merge(merge::Merge) => |it, console, _| merge::run(it, console),
        Plan(plan::Plan) => |it, console, _| plan::run(it, console),
    }
    "Look": {
        View(view::View) => |it, console, interrupt| in_pool(it.threads.count(), || view::run(it, console, interrupt)),
        Render(render::Render) => |it, console, _| in_pool(it.threads.count(), || render::run(it, console)),
        Compare(compare::Compare) => |it, console, _| in_pool(it.threads.count(), || compare::run(it, console)),
        Info(info::Info) => |it, console, _| info::run(it, console),
        Compress(compress::Compress) => |it, console, _| in_pool(it.threads.count(), || compress::run(it, console)),
        Convert(convert::Convert) => |it, console, _| convert::run(it, console),
    }
    "Learn": {
        Train(train::Train) => train::run,
        Eval(eval::Eval) => |it, console, _| in_pool(it.threads.count(), || eval::run(it, console)),
        Config(config::Config) => |it, console, _| config::run(it, console),
        ConvertWeights(convert_weights::ConvertWeights) => convert_weights::run,
    }
    "More": {
        Align(align::Align) => |it, console, _| in_pool(it.threads.count(), || align::run(it, console)),
        Mesh(mesh::Meshing) => |it, console, _| in_pool(it.threads.count(), || mesh::run(it, console)),
        Completions(completions::Completions) => |it, console, _| completions::run(it, console),
    }
    and Method
}
