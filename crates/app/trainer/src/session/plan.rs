//! The plan of a run, as text.

use super::Session;
use crate::Recipe;
use weaver_inference::Density;

impl<R: Recipe> Session<R> {
    /// A description of the run for people.
    pub fn plan(&self) -> String {
        let views: usize = self.scenes.iter().map(|s| s.views.len()).sum();
        let [height, width] = R::image_size(&self.config.model);
        let mut text = format!(
            "preset {}, {width} x {height}, {:.2} M parameters; {} scenes, {views} views{}\n",
            self.config.preset,
            self.params.count() as f64 / 1e6,
            self.scenes.len(),
            if self.fresh.is_some() { ", for samples and evaluation only; fresh scenes for training" } else { "" }
        );
        for stage in &self.config.stages {
            let has = |module: &&str| self.params.iter().any(|(_, param)| param.name().starts_with(module));
            let untrained: Vec<&str> = R::untrained(stage).into_iter().filter(|module| has(module)).collect();
            let frozen: Vec<&str> = stage.frozen.iter().map(String::as_str).collect();
            let parts =
                [("untrained", untrained), ("frozen", frozen)].into_iter().filter(|(_, parts)| !parts.is_empty());
            let notes: String = parts.map(|(why, parts)| format!("; {why}: {}", parts.join(", "))).collect();
            text.push_str(&format!("stage {}: {} steps of {}{notes}\n", stage.name, stage.steps, R::describe(stage)));
        }
        let untrained = self.predictor().ok().and_then(|predictor| predictor.remark(Density::default()));
        let of_scenes = self.scenes.iter().flat_map(|scene| &scene.remarks);
        let warnings: Vec<String> = of_scenes.chain(&untrained).map(|remark| format!("warning: {remark}")).collect();
        for remark in self.remarks.iter().chain(&warnings) {
            text.push_str(&format!("{remark}\n"));
        }
        text
    }
}
