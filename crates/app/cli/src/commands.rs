//! The commands: a file each, with its words and its work, and a row of the table.

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
mod man;
mod merge;
mod mesh;
mod plan;
mod reconstruct;
mod render;
mod split;
mod train;
mod view;

use crate::flags::{EstimateFlags, IfComplete};
use crate::methods::Method;
use crate::table::table;
use clap::Subcommand;
use std::path::PathBuf;
use weaver_command::{Console, Failure, Interrupt, in_pool};
use weaver_data::CamerasSummary;
use weaver_run::Folder;

/// A command as a unit of work.
pub struct Unit {
    /// Folder of the results.
    pub out: PathBuf,
    /// Files and folders that it reads.
    pub inputs: Vec<PathBuf>,
    /// The file in the folder with the output of `--json`.
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
        let read =
            |photos: &[PathBuf], estimate: &EstimateFlags| photos.iter().cloned().chain(estimate.files()).collect();
        let (complete, out, figures, json) = match self {
            Self::Reconstruct(it) => (it.complete, Some(&it.out), Folder::SUMMARY, it.json),
            Self::Cameras(it) => (it.complete, Some(&it.out), CamerasSummary::NAME, it.json),
            Self::Infer(it) => (it.complete, Some(&it.out), infer::FIGURES, it.json),
            Self::Fit(it) => (it.complete, it.out.as_ref(), Folder::SUMMARY, it.json),
            _ => return Ok(None),
        };
        let Some(IfComplete::Skip) = complete.if_complete else { return Ok(None) };
        let out = out.ok_or_else(|| Failure::Usage("--if-complete: expected --out with it".into()))?.to_path_buf();
        // The threads of a fit that goes on.
        let (inputs, fitted) = match self {
            Self::Reconstruct(it) => (read(&it.photos, &it.estimate), Some(it.threads.threads)),
            Self::Cameras(it) => (read(&it.photos, &it.estimate), None),
            Self::Infer(it) => (it.read(), None),
            Self::Fit(it) => (it.read(), Some(it.threads)),
            _ => (Vec::new(), None),
        };
        let resume = |threads| fit::Fit { resume: Some(out.clone()), json, threads, ..fit::Fit::default() };
        let resume = fitted.map(|threads| Self::Fit(resume(threads)));
        Ok(Some(Unit { out, inputs, figures, json, resume }))
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
        Man(man::Manual) => |it, console, _| man::run(it, console),
    }
    and Method
}
