//! `splatweaver vad metrics`.

use crate::command::arguments::VadMetrics;
use crate::metrics::{AveragePrecision, FrameMetrics, frame_metrics};
use crate::{Annotation, FileName};
use serde_json::{Value, json};
use weaver_command::{Console, Failure};
use weaver_io::{Npy, list_files};

pub fn run(arguments: &VadMetrics, console: &mut Console) -> Result<(), Failure> {
    let annotation = Annotation::read(&arguments.annotation)?;
    let mut scores = Vec::new();
    for path in list_files(&arguments.scores, &["npy"])? {
        let array = Npy::open(&path)?;
        let values = array.numbers(0..array.len());
        if array.shape().len() != 1 || values.is_empty() || values.iter().any(|x| !x.is_finite()) {
            let (path, shape) = (path.display(), array.shape());
            return Err(Failure::message(format!(
                "{path}: expected finite scores [S], found shape {shape:?} or a number that is not"
            )));
        }
        let name = path.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
        scores.push((FileName::of(&name).video, values));
    }
    if scores.is_empty() {
        return Err(Failure::message(format!("{}: expected files NAME.npy, found none", arguments.scores.display())));
    }
    let missing = annotation.videos().find(|name| !scores.iter().any(|(other, _)| other == name));
    if let Some(name) = missing {
        let folder = arguments.scores.display();
        return Err(Failure::message(format!("{folder}: expected scores of {name}, which is annotated, found none")));
    }
    let found = frame_metrics(&annotation.join(scores, arguments.length)?);
    console.print(&if arguments.json { json(&found) } else { text(&found) })
}

/// The metrics for people.
pub fn text(metrics: &FrameMetrics) -> String {
    let number = |x: Option<f64>| x.map_or("none: frames of one kind only".into(), |x| format!("{x:.6}"));
    let precision = |ap: Option<AveragePrecision>| {
        ap.map_or("none: no anomalous frame".into(), |ap| format!("{:.6}  ({:.6} by steps)", ap.trapezoid, ap.step))
    };
    let FrameMetrics { frames, positives, abnormal_frames, .. } = metrics;
    format!(
        "frames      {frames}, {positives} of them anomalous, {abnormal_frames} in abnormal videos\n\
         AUC         {}\nAP          {}\nAUC_A       {}\nAP_A        {}\nfalse alarms {}",
        number(metrics.auc),
        precision(metrics.ap),
        number(metrics.auc_abnormal),
        precision(metrics.ap_abnormal),
        metrics.false_alarms.map_or("none: no normal video".into(), |x| format!("{x:.6}")),
    )
}

/// The metrics for programs: null if frames of a kind are missing.
pub fn json(metrics: &FrameMetrics) -> String {
    value(metrics).to_string()
}

/// The metrics as a value of JSON.
pub fn value(metrics: &FrameMetrics) -> Value {
    let precision =
        |ap: Option<AveragePrecision>| json!(ap.map(|ap| json!({"trapezoid": ap.trapezoid, "step": ap.step})));
    json!({
        "frames": metrics.frames,
        "positives": metrics.positives,
        "abnormal_frames": metrics.abnormal_frames,
        "auc": metrics.auc,
        "ap": precision(metrics.ap),
        "auc_abnormal": metrics.auc_abnormal,
        "ap_abnormal": precision(metrics.ap_abnormal),
        "false_alarms": metrics.false_alarms,
    })
}
