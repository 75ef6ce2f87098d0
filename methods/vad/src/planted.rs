//! Videos with planted anomalies and known ground truth.

use crate::Features;
use weaver_kernels::random::Stream;

/// Snippets of a planted video.
const SNIPPETS: usize = 64;
/// Numbers for each snippet.
const WIDTH: usize = 32;
/// Classes of anomalies.
const CLASSES: usize = 4;
/// Share of a snippet's noise that stays in the next.
const CORRELATION: f64 = 0.5;
/// Deviation of the background, which all snippets of a video share.
const BACKGROUND: f64 = 0.5;
/// The core of an event, `exp(-(t - p)^2 / 2 sd^2)` high.
const CORE_SD: f64 = 1.2;
const DISTRACTOR_SD: f64 = 1.5;
const DISTRACTOR: f64 = 3.0;

/// Planted events.
///
/// Features are noise in which each class has a direction for the core of an event and one for its flank. An event is a
/// short core, which distinguishes abnormal videos from normal ones, within a flank of the class's length; all of it is
/// anomalous. Half of the normal videos have the core of class 0 with a tag that excuses it, and all may have
/// distractors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Planted {
    /// Seed of the videos.
    pub seed: u64,
    /// Half the length of an event, by class; it varies by a quarter.
    pub half_lengths: [f64; CLASSES],
    /// Height of cores.
    pub core: f64,
    /// Height of flanks.
    pub flank: f64,
}

/// A planted video.
#[derive(Clone, Debug)]
pub struct PlantedVideo {
    /// Its name, with its class.
    pub name: String,
    /// The class of its anomaly, `None` if it is normal.
    pub class: Option<usize>,
    /// One crop, `[64, 32]`.
    pub features: Features,
    /// Label of each snippet, true if anomalous.
    pub labels: Vec<bool>,
}

impl Planted {
    /// Events of half length 2, 4, 8 and 12.
    pub fn new(seed: u64) -> Self {
        Self { seed, half_lengths: [2.0, 4.0, 8.0, 12.0], core: 4.0, flank: 2.5 }
    }

    /// The names of the classes.
    pub fn classes() -> Vec<String> {
        (0..CLASSES).map(|class| format!("Class{}", char::from(b'A' + class as u8))).collect()
    }

    /// 240 videos to train on, the abnormal half first, its classes in turn.
    pub fn training(&self) -> Vec<PlantedVideo> {
        self.videos("train", 240)
    }

    /// 120 videos to test on, in the same order.
    pub fn test(&self) -> Vec<PlantedVideo> {
        self.videos("test", 120)
    }

    fn videos(&self, split: &str, count: usize) -> Vec<PlantedVideo> {
        let stream = Stream::new(self.seed, 0, &format!("vad.planted.{split}"));
        let directions = self.directions();
        (0..count).map(|i| self.video(stream.fork(i as u64), i, count / 2, &directions)).collect()
    }

    /// Orthonormal directions: cores, flanks, distractor, tag.
    fn directions(&self) -> Directions {
        let stream = Stream::new(self.seed, 0, "vad.planted.directions");
        let mut all: Vec<[f64; WIDTH]> = Vec::new();
        for k in 0..2 * CLASSES + 2 {
            let mut new: [f64; WIDTH] = std::array::from_fn(|d| stream.normal((k * WIDTH + d) as u64));
            // Twice, for orthogonality in spite of rounding.
            for _ in 0..2 {
                all.iter().for_each(|other| remove(&mut new, other));
            }
            let length = dot(&new, &new).sqrt();
            new.iter_mut().for_each(|x| *x /= length);
            all.push(new);
        }
        Directions { all }
    }

    fn video(&self, stream: Stream, index: usize, abnormal: usize, directions: &Directions) -> PlantedVideo {
        let class = (index < abnormal).then_some(index % CLASSES);
        let mut draw = 0;
        let mut next = || {
            draw += 1;
            stream.fork(1).uniform::<f64>(draw)
        };
        let mut x = noise(stream.fork(2), directions);
        let mut bump = |direction: &[f64; WIDTH], height: f64, at: f64, sd: f64| {
            for (t, row) in x.chunks_exact_mut(WIDTH).enumerate() {
                let distance = t as f64 - at;
                let value = height * (-distance * distance / (2.0 * sd * sd)).exp();
                row.iter_mut().zip(direction).for_each(|(x, d)| *x += value * d);
            }
        };
        let distractors = (3.0 * next()) as usize;
        for _ in 0..distractors {
            bump(directions.distractor(), DISTRACTOR, next() * SNIPPETS as f64, DISTRACTOR_SD);
        }
        let mut labels = vec![false; SNIPPETS];
        let Some(class) = class else {
            if index.is_multiple_of(2) {
                let at = next() * SNIPPETS as f64;
                bump(directions.core(0), self.core, at, CORE_SD);
                bump(directions.tag(), self.core, at, CORE_SD);
            }
            let name = format!("Normal{index:03}");
            return PlantedVideo { name, class: None, features: in_memory(&x), labels };
        };
        let events = if next() < 0.25 { 2 } else { 1 };
        let mut flanks = [false; SNIPPETS];
        for _ in 0..events {
            let half = self.half_lengths[class] * (0.75 + 0.5 * next());
            // The core lies within the video.
            let at = (2.0 + next() * (SNIPPETS as f64 - 4.0)).floor();
            bump(directions.core(class), self.core, at, CORE_SD);
            (0..SNIPPETS).filter(|t| (*t as f64 - at).abs() <= half).for_each(|t| flanks[t] = true);
        }
        for (t, row) in x.chunks_exact_mut(WIDTH).enumerate().filter(|(t, _)| flanks[*t]) {
            row.iter_mut().zip(directions.flank(class)).for_each(|(x, d)| *x += self.flank * d);
            labels[t] = true;
        }
        let name = format!("{}{index:03}", Self::classes()[class]);
        PlantedVideo { name, class: Some(class), features: in_memory(&x), labels }
    }

    /// The posterior probability of an event at each snippet of a video, given all planted parameters but the
    /// positions: an upper bound for scores, up to chance. Events have their class's half length; a video has one
    /// event, or an excused core, or nothing.
    pub fn matched_filter(&self, features: &[f32]) -> Vec<f32> {
        let directions = self.directions();
        let x: Vec<f64> = features.iter().map(|x| f64::from(*x)).collect();
        // Projections, made white: n_t - rho n_(t-1) has variance 1 - rho^2.
        let project = |d: &[f64; WIDTH]| whiten(&x.chunks_exact(WIDTH).map(|row| dot(row, d)).collect::<Vec<_>>());
        let ratio = |seen: &[f64], template: &[f64]| -> f64 {
            let template = whiten(template);
            seen.iter().zip(&template).map(|(x, m)| x * m - 0.5 * m * m).sum()
        };
        let bump = |at: usize| -> Vec<f64> {
            let value = |t: usize| self.core * (-(t as f64 - at as f64).powi(2) / (2.0 * CORE_SD * CORE_SD)).exp();
            (0..SNIPPETS).map(value).collect()
        };
        let tag = project(directions.tag());
        let classes: Vec<[Vec<f64>; 2]> =
            (0..CLASSES).map(|class| [directions.core(class), directions.flank(class)].map(project)).collect();
        let mut hypotheses: Vec<(f64, std::ops::Range<usize>)> = vec![(0.0, 0..0)];
        for at in 0..SNIPPETS {
            let core = bump(at);
            hypotheses.push((ratio(&classes[0][0], &core) + ratio(&tag, &core), 0..0));
            for ([seen_core, seen_flank], half_length) in classes.iter().zip(self.half_lengths) {
                let of_core = ratio(seen_core, &core);
                for share in [0.8, 0.9, 1.0, 1.1, 1.2] {
                    let half = (half_length * share) as usize;
                    let range = at.saturating_sub(half)..(at + half + 1).min(SNIPPETS);
                    let flank: Vec<f64> =
                        (0..SNIPPETS).map(|t| if range.contains(&t) { self.flank } else { 0.0 }).collect();
                    hypotheses.push((of_core + ratio(seen_flank, &flank), range));
                }
            }
        }
        let most = hypotheses.iter().map(|(log, _)| *log).fold(f64::MIN, f64::max);
        let mut inside = vec![0.0; SNIPPETS];
        let mut total = 0.0;
        for (log, range) in hypotheses {
            let weight = (log - most).exp();
            total += weight;
            inside[range].iter_mut().for_each(|p| *p += weight);
        }
        inside.into_iter().map(|p| (p / total) as f32).collect()
    }
}

/// Orthonormal directions.
struct Directions {
    all: Vec<[f64; WIDTH]>,
}

impl Directions {
    fn core(&self, class: usize) -> &[f64; WIDTH] {
        &self.all[class]
    }
    fn flank(&self, class: usize) -> &[f64; WIDTH] {
        &self.all[CLASSES + class]
    }
    fn distractor(&self) -> &[f64; WIDTH] {
        &self.all[2 * CLASSES]
    }
    fn tag(&self) -> &[f64; WIDTH] {
        &self.all[2 * CLASSES + 1]
    }
}

/// The common part of all snippets, independent of any direction, and correlated noise.
fn noise(stream: Stream, directions: &Directions) -> Vec<f64> {
    let mut common: [f64; WIDTH] = std::array::from_fn(|d| BACKGROUND * stream.normal::<f64>(d as u64));
    directions.all.iter().for_each(|direction| remove(&mut common, direction));
    let fresh = (1.0 - CORRELATION * CORRELATION).sqrt();
    let mut x = vec![0.0; SNIPPETS * WIDTH];
    for d in 0..WIDTH {
        let mut lingering = 0.0;
        for t in 0..SNIPPETS {
            let z: f64 = stream.normal((WIDTH + t * WIDTH + d) as u64);
            lingering = if t == 0 { z } else { CORRELATION * lingering + fresh * z };
            x[t * WIDTH + d] = common[d] + lingering;
        }
    }
    x
}

fn whiten(x: &[f64]) -> Vec<f64> {
    let fresh = (1.0 - CORRELATION * CORRELATION).sqrt();
    let white = |t: usize| if t == 0 { x[0] } else { (x[t] - CORRELATION * x[t - 1]) / fresh };
    (0..x.len()).map(white).collect()
}

fn in_memory(x: &[f64]) -> Features {
    Features::in_memory(x.iter().map(|x| *x as f32).collect(), WIDTH)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Subtracts the projection on a unit direction.
fn remove(x: &mut [f64], direction: &[f64]) {
    let along = dot(x, direction);
    x.iter_mut().zip(direction).for_each(|(x, d)| *x -= along * d);
}
