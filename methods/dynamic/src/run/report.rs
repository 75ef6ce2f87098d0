//! The report of a run.

use crate::run::show::COLOR_NAMES;
use crate::run::{Evaluation, Run, RunError, Scores};
use weaver_run::Page;

/// Pictures in a strip.
const SHOWN: usize = 8;

impl Run {
    /// Writes `summary.json` and `report.html`.
    ///
    /// # Errors
    /// When a file cannot be written, or the rasterizer refuses.
    pub fn report(&self, evaluation: &Evaluation) -> Result<(), RunError> {
        self.writing(|folder| Ok(folder.summarize(evaluation)?))?;
        let mut page = Page::new(&format!("{}: a mixture of moving Gaussians", self.film.name));
        page.heading(1, &self.film.name);
        let [height, width] = self.film.size;
        let shots = self.film.shots.len();
        page.paragraph(&format!(
            "{shots} photos of {width} x {height} pixels at {} times; {} Gaussians in all.",
            self.film.times().len(),
            self.mixture.counts().iter().sum::<usize>(),
        ));
        if let Some(origin) = &self.settings.derived_from {
            page.paragraph(&format!("Made from {} by {}.", origin.from.display(), origin.by));
        }
        self.film.remarks.iter().for_each(|remark| {
            page.paragraph(remark);
        });
        tables(&mut page, evaluation);
        page.heading(2, "Over time");
        let colors: Vec<String> = evaluation
            .experts
            .iter()
            .zip(COLOR_NAMES.iter().cycle())
            .map(|(name, color)| format!("{name} {color}"))
            .collect();
        page.paragraph(&format!("In the gate: {}.", colors.join(", ")));
        for strip in self.strips(SHOWN)? {
            page.picture(&strip.name, &strip.image);
        }
        self.writing(|folder| {
            page.curves(&folder.records()?, &[]);
            page.heading(2, "Settings");
            page.preformatted(&serde_json::to_string_pretty(&self.settings).expect("settings are plain data"));
            Ok(folder.report(&page)?)
        })
    }
}

fn tables(page: &mut Page, evaluation: &Evaluation) {
    let groups = evaluation.groups();
    page.heading(2, "How photos are met");
    let header: Vec<&str> = std::iter::once("PSNR, dB (SSIM)").chain(groups.iter().map(|(name, _)| *name)).collect();
    page.table(&header, &evaluation.rows());
    page.heading(2, "Whom the gate believes");
    let shares = |(k, name): (usize, &String)| {
        let own = groups.iter().map(|(_, scores)| format!("{:.3}", scores.shares[k]));
        std::iter::once(name.clone()).chain(own).collect::<Vec<_>>()
    };
    let mut rows: Vec<Vec<String>> = evaluation.experts.iter().enumerate().map(shares).collect();
    let right = groups.iter().map(|(_, scores)| format!("{:.1} %", 100.0 * scores.right));
    rows.push(std::iter::once("right, where experts differ".into()).chain(right).collect());
    let header: Vec<&str> = std::iter::once("mean gate").chain(groups.iter().map(|(name, _)| *name)).collect();
    page.table(&header, &rows);
    if evaluation.motions.is_empty() {
        return;
    }
    page.heading(2, "By kind of motion");
    page.paragraph("PSNR over the pixels of held-out photos that show it, dB, and the mean gate there.");
    let names = evaluation.experts.iter().map(String::as_str);
    let header: Vec<&str> = ["motion", "pixels"].into_iter().chain(names).chain(["mixture"]).collect();
    let row = |scores: &crate::run::MotionScores| {
        let experts = scores.psnr.0.iter().zip(&scores.shares).map(|(psnr, share)| format!("{psnr:.2} ({share:.2})"));
        let first = [scores.motion.clone(), scores.pixels.to_string()];
        first.into_iter().chain(experts).chain([format!("{:.2}", scores.psnr.1)]).collect::<Vec<_>>()
    };
    page.table(&header, &evaluation.motions.iter().map(row).collect::<Vec<_>>());
}

impl Evaluation {
    /// The present kinds of photos, with their names.
    pub fn groups(&self) -> Vec<(&'static str, &Scores)> {
        let all = [
            ("held-out cameras", &self.held_out_cameras),
            ("held-out times", &self.held_out_times),
            ("held-out both", &self.held_out_both),
            ("trained on", &self.trained),
        ];
        all.into_iter().filter_map(|(name, scores)| scores.as_ref().map(|scores| (name, scores))).collect()
    }

    /// A table: a row for each expert, the uniform mean, the mixture and the oracle, a column for each kind of photos.
    pub fn rows(&self) -> Vec<Vec<String>> {
        let groups = self.groups();
        let row = |name: &str, of: &dyn Fn(&Scores) -> crate::run::Quality| {
            let cell = |(_, scores): &(&str, &Scores)| {
                let crate::run::Quality { psnr, ssim } = of(scores);
                ssim.map_or(format!("{psnr:.2}"), |ssim| format!("{psnr:.2} ({ssim:.3})"))
            };
            std::iter::once(name.to_string()).chain(groups.iter().map(cell)).collect::<Vec<_>>()
        };
        let expert = |(k, name): (usize, &String)| row(name, &move |scores| scores.experts[k]);
        let mut rows: Vec<Vec<String>> = self.experts.iter().enumerate().map(expert).collect();
        rows.push(row("uniform mean", &|scores| scores.uniform));
        rows.push(row("mixture", &|scores| scores.mixture));
        rows.push(row("oracle", &|scores| scores.oracle));
        rows
    }
}
