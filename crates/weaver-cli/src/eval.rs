//! `splatweaver eval`.

use crate::Console;
use crate::arguments::Eval;
use crate::failure::Failure;
use crate::progress::Progress;
use weaver_trainer::evaluate::{self, Options, Source};

pub fn run(arguments: &Eval, console: &mut Console) -> Result<(), Failure> {
    let source = match (arguments.unseen, arguments.data.is_empty()) {
        (true, _) => Source::Unseen,
        (false, true) => Source::Run,
        (false, false) => Source::Folders(arguments.data.clone()),
    };
    let options = Options {
        context_views: arguments.views,
        cameras: arguments.cameras,
        allocation: arguments.dial.allocation,
        budget: arguments.dial.budget,
        lpips: arguments.lpips.clone(),
    };
    let mut progress = Progress::new("eval", 0, 0, console);
    let mut show = |done, total| progress.at(done, total, String::new, console);
    let evaluation = evaluate::run(&arguments.run, &source, &options, &mut show);
    progress.finish();
    let evaluation = evaluation?;
    if arguments.json {
        console.print(&serde_json::to_string_pretty(&evaluation)?)
    } else {
        console.print(&evaluation.table())
    }
}
