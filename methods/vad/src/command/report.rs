//! The page about a run's test videos.

use crate::command::judged::Judged;
use crate::command::metrics::{text, value};
use crate::command::score::{others, shares};
use crate::{Chart, Curves};
use weaver_command::Failure;
use weaver_run::{Folder, Page};

/// Videos that are drawn.
const SHOWN: usize = 10;

/// Leaves metrics and a page with curves in a run's folder.
pub fn leave(judged: &Judged, experts: &[String], folder: &Folder) -> Result<(), Failure> {
    folder.summarize(&value(&judged.metrics()))?;
    Ok(folder.report(page(judged, experts).curves(&folder.records()?, &[]))?)
}

/// Metrics, the share of each expert, and the curves of ten videos, most of them abnormal.
pub fn page(judged: &Judged, experts: &[String]) -> Page {
    let mut page = Page::new("Video anomalies");
    page.heading(1, "Video anomalies").preformatted(&text(&judged.metrics()));
    page.paragraph(
        "AUC and AP pool the frames of all videos; AUC_A and AP_A those of abnormal videos alone. Only the latter tell whether anomalies are \
         found within videos: the label of the video as the score of all its frames has an AUC_A of 0.5.",
    );
    if !experts.is_empty() {
        let rows: Vec<[String; 2]> =
            experts.iter().cloned().zip(leading(&judged.curves, experts.len())).map(<[String; 2]>::from).collect();
        page.heading(2, "Experts");
        page.paragraph(
            "Where the score is at least 0.5: the share of snippets at which an expert's own score is the highest.",
        );
        page.table(&["expert", "share"], &rows);
    }
    page.heading(2, "Videos");
    page.paragraph(
        "Blue: the score. Thin: the experts, in the order of the table, from orange on, and last the encoder. Red: what is anomalous.",
    );
    for i in shown(judged) {
        let (curves, anomalous) = (&judged.curves[i], shares(&judged.scored[i].labels));
        let image = Chart { scores: curves.scores(), others: others(curves), anomalous }.draw();
        page.picture(&judged.names[i], &image);
    }
    page
}

/// Ten videos spread over the list, or as many as there are: at most three normal ones, the others abnormal.
fn shown(judged: &Judged) -> Vec<usize> {
    let of = |abnormal: bool| -> Vec<usize> {
        (0..judged.scored.len()).filter(|i| judged.scored[*i].is_abnormal() == abnormal).collect()
    };
    let spread = |from: &[usize], count: usize| -> Vec<usize> {
        let count = count.min(from.len());
        (0..count).map(|i| from[i * from.len() / count]).collect()
    };
    let normal = spread(&of(false), SHOWN - 7);
    let abnormal = spread(&of(true), SHOWN - normal.len());
    abnormal.into_iter().chain(normal).collect()
}

/// For each expert, the percentage of snippets with a score of at least 0.5 at which its own score is the highest.
fn leading(curves: &[Curves], experts: usize) -> Vec<String> {
    let mut leads = vec![0_usize; experts];
    for of in curves {
        for (i, _) in of.scores().iter().enumerate().filter(|(_, score)| **score >= 0.5) {
            let highest = (0..experts).max_by(|a, b| of.experts[*a][i].total_cmp(&of.experts[*b][i]));
            highest.into_iter().for_each(|e| leads[e] += 1);
        }
    }
    let all = leads.iter().sum::<usize>().max(1);
    leads.into_iter().map(|n| format!("{:.1} %", 100.0 * n as f64 / all as f64)).collect()
}
