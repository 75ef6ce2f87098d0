//! The worth of each part of the method on planted anomalies: all rows from the same encoder, videos and number of
//! steps.
//!
//! `ladder [urdmu|convolutions] [SEEDS] [RATE] [short]`: AUC and AUC over abnormal videos of every row, means over the
//! seeds with standard errors, and paired differences with intervals of 95 %. SEEDS is a number of them or a range such
//! as 2..4; `short` plants only short events. One thread.

use crate::Outcome;
use crate::arguments::Arguments;
use crate::table::{Rows, Table, mean};
use std::ops::Range;
use weaver_command::in_pool;
use weaver_vad::metrics::{FrameMetrics, SNIPPET, ScoredVideo, frame_metrics};
use weaver_vad::{
    ConvolutionSizes, Curves, DeepMilSizes, Detector, EncoderKind, Experts, Labels, Planted, PlantedVideo, Result,
    Rule, Schedule, Splatting, Stage, Trainer, TrainingSet, UrDmuSizes,
};

const FEATURES: usize = 32;

pub fn run(mut arguments: Arguments) -> Outcome {
    let encoder = arguments.optional("urdmu or convolutions")?.unwrap_or_else(|| "urdmu".to_string());
    let seeds = arguments.optional("seeds")?.unwrap_or_else(|| "6".to_string());
    let (first, end) = seeds.split_once("..").unwrap_or(("0", &seeds));
    let seeds = first.parse()?..end.parse()?;
    let published = Schedule::planted(Labels::None, Experts::None, 0).encoder.rate;
    let rate = arguments.optional("a rate")?.unwrap_or(published);
    let short = arguments.rest::<String>("short")?.iter().any(|word| word == "short");
    let rows = in_pool(Some(1), || Ok(climbed(&encoder, seeds, rate, short)?));
    summary(&rows.map_err(|failure| failure.line().unwrap_or_default())?);
    Ok(())
}

/// AUC and AUC over abnormal videos of all rows and seeds.
fn climbed(encoder: &str, seeds: Range<u64>, rate: f64, short: bool) -> Result<Rows> {
    let mut rows = Rows::default();
    for seed in seeds {
        let half_lengths = if short { [2.0; 4] } else { Planted::new(seed).half_lengths };
        let mut ladder = Ladder::new(Planted { half_lengths, ..Planted::new(seed) }, encoder, rate);
        ladder.run(short)?;
        ladder.rows.iter().for_each(|(name, figures)| rows.add(name, figures));
    }
    Ok(rows)
}

struct Ladder {
    planted: Planted,
    kinds: [EncoderKind; 2],
    set: TrainingSet,
    test: Vec<PlantedVideo>,
    rate: f64,
    rows: Vec<(String, [f64; 2])>,
}

impl Ladder {
    fn new(planted: Planted, encoder: &str, rate: f64) -> Self {
        let kind = |classes| match encoder {
            "convolutions" => EncoderKind::Convolutions(ConvolutionSizes { features: FEATURES, width: 32, classes }),
            _ => EncoderKind::UrDmu(UrDmuSizes { classes, ..UrDmuSizes::small(FEATURES) }),
        };
        let set = TrainingSet::planted(&planted);
        Self { planted, kinds: [kind(0), kind(4)], set, test: planted.test(), rate, rows: Vec::new() }
    }

    fn run(&mut self, short: bool) -> Result<()> {
        let splat = |rule| Labels::Splat(Splatting::with(rule));
        let t = splat(Rule::Time);
        self.oracles();
        let plain = self.begun(self.kinds[0])?;
        self.row("plain", &plain)?;
        let mut on_labels = Vec::new();
        let labels = [
            ("the same steps", Labels::None),
            ("+ T", t),
            ("+ S", splat(Rule::Score)),
            ("+ H", splat(Rule::Video)),
            ("+ L", splat(Rule::Literal)),
            ("+ own scores", Labels::Scores),
            ("+ own scores above 0.5", Labels::Above(0.5)),
        ];
        for (name, labels) in labels {
            let detector = self.continued(&plain, labels)?;
            self.row(name, &detector)?;
            on_labels.push(detector);
        }
        self.note("the same steps: of events and of the rest above half the peak", self.above_half(&on_labels[0])?);
        self.note("+ T: of events and of the rest above half the peak", self.above_half(&on_labels[1])?);
        if short {
            return Ok(());
        }
        self.experts("class", &on_labels[1], t, None)?;
        self.experts("cluster", &on_labels[1], t, Some(4))?;
        let heads = self.begun(self.kinds[1])?;
        self.row("class heads", &heads)?;
        let metrics = self.judged(&heads, |curves| highest(&curves.classes))?;
        self.push("class heads, the highest", &metrics);
        let same = self.continued(&heads, Labels::None)?;
        self.row("class heads, the same steps", &same)?;
        let splatted = self.continued(&heads, t)?;
        self.row("class heads + T", &splatted)?;
        let gated = self.experts("class heads + T, class", &splatted, t, None)?;
        self.specialists(&gated)?;
        self.experts("class heads + T, class, no labels,", &splatted, Labels::None, None)?;
        self.experts("class heads, class", &heads, t, None)?;
        let published = splatted.clone().with_published_experts();
        self.experts("class heads + T, class, as published,", &published, t, None)?;
        self.baselines()
    }

    fn stage(&self, steps: usize) -> Stage {
        Stage { steps, rate: self.rate, l2: 5e-5, decay: 0.0, dropout: 0.1 }
    }

    fn trainer(&self, segments: usize) -> Trainer<'_> {
        Trainer { set: &self.set, segments, batch: 12, seed: self.planted.seed }
    }

    /// An encoder after the first 300 steps.
    fn begun(&self, kind: EncoderKind) -> Result<Detector> {
        let mut detector = Detector::new(kind, self.planted.seed);
        self.trainer(64).encoder(&mut detector, &self.stage(300), Labels::None, &mut |_| ())?;
        Ok(detector)
    }

    /// The encoder after 200 more steps.
    fn continued(&self, from: &Detector, labels: Labels) -> Result<Detector> {
        let mut detector = from.clone();
        self.trainer(64).encoder(&mut detector, &self.stage(200), labels, &mut |_| ())?;
        Ok(detector)
    }

    /// Rows with experts, and with their gate.
    fn experts(&mut self, name: &str, from: &Detector, labels: Labels, clusters: Option<usize>) -> Result<Detector> {
        let Schedule { expert, gate, .. } = Schedule::planted(labels, Experts::Classes, self.planted.seed);
        let mut detector = from.clone();
        let trainer = self.trainer(64);
        let groups = match clusters {
            None => trainer.by_class(),
            Some(k) => trainer.by_cluster(&detector, k)?,
        };
        trainer.experts(&mut detector, &groups, &expert, labels, &mut |_| ())?;
        let metrics = self.judged(&detector, |curves| highest(&curves.experts))?;
        self.push(&format!("{name} experts, the highest"), &metrics);
        self.trainer(64).gate(&mut detector, &gate, labels, &mut |_| ())?;
        self.row(&format!("{name} experts + gate"), &detector)?;
        Ok(detector)
    }

    /// Success of experts on anomalies of their own class and of others, and the gate's loss without one.
    fn specialists(&mut self, detector: &Detector) -> Result<()> {
        let (mut own, mut other, mut lost) = (Vec::new(), Vec::new(), Vec::new());
        let whole = self.judged(detector, |curves| curves.scores().to_vec())?.auc_abnormal.unwrap_or(f64::NAN);
        for e in 0..detector.experts().len() {
            for class in 0..4 {
                let videos: Vec<&PlantedVideo> = self.test.iter().filter(|v| v.class == Some(class)).collect();
                let metrics = judged(&videos, |video| Ok(detector.curves(&video.features)?.experts[e].clone()))?;
                if e == class { &mut own } else { &mut other }.push(metrics.auc_abnormal.unwrap_or(f64::NAN));
            }
            let videos: Vec<&PlantedVideo> = self.test.iter().collect();
            let masked =
                |video: &PlantedVideo| Ok(detector.curves_without(&video.features, Some(e))?.scores().to_vec());
            lost.push(whole - judged(&videos, masked)?.auc_abnormal.unwrap_or(f64::NAN));
        }
        self.note("an expert on its own class", [f64::NAN, mean(&own)]);
        self.note("an expert on other classes", [f64::NAN, mean(&other)]);
        self.note("what the gate loses without an expert", [f64::NAN, mean(&lost)]);
        Ok(())
    }

    fn baselines(&mut self) -> Result<()> {
        let deepmil = EncoderKind::DeepMil(DeepMilSizes { features: FEATURES, hidden: [64, 32] });
        let rtfm = EncoderKind::Rtfm(ConvolutionSizes { features: FEATURES, width: 64, classes: 0 });
        for (name, kind, l2, dropout) in [("DeepMIL", deepmil, 0.0, 0.6), ("RTFM", rtfm, 0.005, 0.0)] {
            let mut detector = Detector::new(kind, self.planted.seed);
            let stage = Stage { steps: 500, rate: 1e-3, l2, decay: 0.0, dropout };
            self.trainer(32).encoder(&mut detector, &stage, Labels::None, &mut |_| ())?;
            self.row(name, &detector)?;
        }
        Ok(())
    }

    /// Scores from the labels of videos, and from all planted parameters but the positions of events.
    fn oracles(&mut self) {
        let all: Vec<&PlantedVideo> = self.test.iter().collect();
        let planted = self.planted;
        let of_video = judged(&all, |video| Ok(vec![f32::from(u8::from(video.class.is_some())); video.labels.len()]));
        let matched = judged(&all, |video| Ok(planted.matched_filter(&video.features.crop(0)?)));
        for (name, metrics) in [("the video's label as its score", of_video), ("matched filter", matched)] {
            if let Ok(metrics) = metrics {
                self.push(name, &metrics);
            }
        }
    }

    /// Shares of snippets with more than half of their video's highest score: among snippets of events, and among the
    /// other snippets of the same videos.
    fn above_half(&self, detector: &Detector) -> Result<[f64; 2]> {
        let (mut above, mut all) = ([0.0; 2], [0.0; 2]);
        for video in self.test.iter().filter(|video| video.class.is_some()) {
            let curves = detector.curves(&video.features)?;
            let half = 0.5 * curves.scores().iter().fold(0.0, |most: f32, s| most.max(*s));
            for (score, label) in curves.scores().iter().zip(&video.labels) {
                let side = usize::from(!label);
                all[side] += 1.0;
                above[side] += f64::from(u8::from(*score > half));
            }
        }
        Ok([0, 1].map(|side| above[side] / all[side]))
    }

    fn row(&mut self, name: &str, detector: &Detector) -> Result<()> {
        let metrics = self.judged(detector, |curves| curves.scores().to_vec())?;
        self.push(name, &metrics);
        Ok(())
    }

    fn push(&mut self, name: &str, metrics: &FrameMetrics) {
        let number = |x: Option<f64>| x.unwrap_or(f64::NAN);
        self.note(name, [number(metrics.auc), number(metrics.auc_abnormal)]);
    }

    fn note(&mut self, name: &str, [auc, abnormal]: [f64; 2]) {
        self.rows.push((name.to_string(), [auc, abnormal]));
    }

    fn judged(&self, detector: &Detector, scores: impl Fn(Curves) -> Vec<f32>) -> Result<FrameMetrics> {
        let all: Vec<&PlantedVideo> = self.test.iter().collect();
        judged(&all, |video| Ok(scores(detector.curves(&video.features)?)))
    }
}

fn judged(videos: &[&PlantedVideo], scores: impl Fn(&PlantedVideo) -> Result<Vec<f32>>) -> Result<FrameMetrics> {
    let frames = |labels: &[bool]| labels.iter().flat_map(|label| [*label; SNIPPET]).collect();
    let scored = videos.iter().map(|video| Ok(ScoredVideo { scores: scores(video)?, labels: frames(&video.labels) }));
    Ok(frame_metrics(&scored.collect::<Result<Vec<_>>>()?))
}

fn summary(rows: &Rows) {
    let cell = |seeds: &[f64]| {
        let (mean, error) = mean_and_error(seeds);
        format!("{mean:.3} +- {error:.3}")
    };
    rows.print("Planted anomalies", &["AUC", "AUC_A"], cell);
    let abnormal = |name: &str| rows.figure(name, 1);
    // The matched filter is the best possible score.
    if let Some(filter) = abnormal("matched filter").map(|seeds| mean(&seeds)) {
        for name in rows.names().filter(|name| !name.contains("half the peak")) {
            let found = abnormal(name).map_or(f64::NAN, |seeds| mean(&seeds));
            assert!(found.is_nan() || found <= filter + 0.01, "{name} is above the matched filter: {found}");
        }
    }
    let table = Table::new("Paired differences of AUC_A", &["mean", "95 % interval"]);
    for (name, against) in [
        ("+ T", "the same steps"),
        ("+ S", "the same steps"),
        ("+ H", "the same steps"),
        ("+ L", "the same steps"),
        ("+ own scores", "the same steps"),
        ("+ own scores above 0.5", "the same steps"),
        ("class experts + gate", "+ T"),
        ("cluster experts + gate", "+ T"),
        ("class heads + T", "class heads, the same steps"),
        ("class heads + T, class experts + gate", "class heads + T"),
        ("class heads + T, class experts + gate", "class heads, class experts + gate"),
        ("class heads + T, class experts + gate", "class heads, the same steps"),
        ("class heads + T, class experts + gate", "plain"),
        ("class heads + T, class experts + gate", "class heads + T, class, no labels, experts + gate"),
    ] {
        let (Some(a), Some(b)) = (abnormal(name), abnormal(against)) else { continue };
        let difference: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a - b).collect();
        let (mean, error) = mean_and_error(&difference);
        let reach = error * student(difference.len());
        let interval = format!("[{:+.4}, {:+.4}]", mean - reach, mean + reach);
        table.row(&format!("{name} - {against}"), &[format!("{mean:+.4}"), interval]);
    }
}

/// The highest of several curves, snippet by snippet.
fn highest(curves: &[Vec<f32>]) -> Vec<f32> {
    let snippets = curves.first().map_or(0, Vec::len);
    (0..snippets).map(|i| curves.iter().map(|curve| curve[i]).fold(0.0, f32::max)).collect()
}

/// The mean and its standard error.
fn mean_and_error(x: &[f64]) -> (f64, f64) {
    let n = x.len() as f64;
    let mean = mean(x);
    (mean, (x.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / (n - 1.0) / n).sqrt())
}

/// The 97.5th percentile of Student's distribution for a mean of n numbers.
fn student(n: usize) -> f64 {
    [f64::NAN, f64::NAN, 12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262].get(n).copied().unwrap_or(2.0)
}
