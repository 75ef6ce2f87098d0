//! `splatweaver vad eval`.

use crate::command::arguments::VadEval;
use crate::command::judged::{Judged, planted};
use crate::command::train::KIND;
use crate::command::{check_width, metrics, open, report};
use crate::{Annotation, Planted, read_list};
use weaver_command::{Console, Failure, Progress};
use weaver_run::Folder;

pub fn run(arguments: &VadEval, console: &mut Console) -> Result<(), Failure> {
    let (detector, model, metadata) = open(&arguments.run)?;
    let judged = match (&arguments.features, &arguments.list, &arguments.annotation) {
        (Some(features), Some(list), Some(annotation)) => {
            let annotation = Annotation::read(annotation)?;
            let videos = read_list(list, features)?;
            let (mut names, mut curves) = (Vec::new(), Vec::new());
            let mut progress = Progress::new("eval", 0, videos.len(), console);
            let total = videos.len();
            for (i, video) in videos.into_iter().enumerate() {
                check_width(&detector, video.features.width(), &video.name, &model)?;
                curves.push(detector.curves(&video.features)?);
                progress.at(i + 1, total, || video.name.clone(), console);
                names.push(video.name);
            }
            progress.finish();
            let scores = names.iter().cloned().zip(curves.iter().map(|curves| curves.scores().to_vec())).collect();
            let scored = annotation.join(scores, arguments.length)?;
            Judged { names, curves, scored }
        }
        _ => {
            let seed = metadata.parse().map_err(|_| {
                let model = model.display();
                Failure::Usage(format!(
                    "{model}: not trained on planted videos; give --features, --list and --annotation"
                ))
            })?;
            planted(&detector, &Planted::new(seed))?
        }
    };
    let found = judged.metrics();
    console.print(&if arguments.json { metrics::json(&found) } else { metrics::text(&found) })?;
    let path = if let Some(path) = &arguments.report {
        report::page(&judged, detector.experts()).write(path)?;
        path.to_path_buf()
    } else if arguments.run.is_dir() {
        report::leave(&judged, detector.experts(), &Folder::reopen(&arguments.run, KIND)?)?;
        arguments.run.join(Folder::REPORT)
    } else {
        return Ok(());
    };
    console.note(&format!("report: {}", path.display()));
    Ok(())
}
