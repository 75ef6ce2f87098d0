//! Temporal Gaussian splatting: labels for the snippets of a video from the peaks of its score curve.
//!
//! D'Amicantonio et al., arXiv 2508.06318, section 3.2. The text leaves two points open: the width of a peak from the
//! rise and the fall around it, and the axis of its Gaussian, time or score; [`Rule`] has each reading.

/// Rule by which a peak becomes a label.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// Over time, in the width at half prominence: `exp(-(t - P)^2 / 2 sd^2)` with `sd = max(1, length / 2.355)`.
    Time,
    /// Over the score: `[|t - P| <= W] exp(-(s_t - s_P)^2 / 2 sigma^2)`, `W` the longer of rise and fall.
    Score,
    /// Over time from -1 to 1 across the video, within `sigma` of the peak's score.
    Video,
    /// Over time in snippets with the deviation of the scores, the literal reading: a spike, since `sigma <= 0.5`.
    Literal,
}

impl Rule {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Time, Self::Score, Self::Video, Self::Literal];

    /// The rule's letter: T, S, H or L.
    pub fn letter(self) -> &'static str {
        match self {
            Self::Time => "T",
            Self::Score => "S",
            Self::Video => "H",
            Self::Literal => "L",
        }
    }
}

/// Selection of peaks, and the rule for their labels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splatting {
    /// Rule by which a peak becomes a label.
    pub rule: Rule,
    /// Least prominence of a peak (theta).
    pub prominence: f64,
    /// Least score of a peak, for [`Rule::Time`].
    pub least: f64,
}

impl Splatting {
    /// The published threshold.
    pub fn with(rule: Rule) -> Self {
        Self { rule, prominence: 0.2, least: 0.5 }
    }

    /// Labels in [0, 1] for a curve of scores: the sum of all peaks' Gaussians, at most 1. All 0 without a prominent
    /// peak.
    ///
    /// ```
    /// use weaver_vad::{Rule, Splatting};
    /// let scores = [0.1, 0.1, 0.2, 0.5, 0.9, 0.6, 0.3, 0.1, 0.1, 0.1];
    /// let labels = Splatting::with(Rule::Literal).labels(&scores);
    /// assert!(labels[4] == 1.0 && labels.iter().sum::<f64>() < 1.01);
    /// assert_eq!(Splatting::with(Rule::Time).labels(&[0.7; 10]), [0.0; 10]);
    /// ```
    pub fn labels(&self, scores: &[f64]) -> Vec<f64> {
        let mut labels = vec![0.0; scores.len()];
        let mut add = |t: usize, value: f64| labels[t] += value;
        match self.rule {
            Rule::Time => {
                for peak in topographic_peaks(scores, self.prominence, self.least) {
                    gaussian_in_time(scores, peak, &mut add);
                }
            }
            rule => {
                for at in window_peaks(scores, self.prominence) {
                    gaussian_in_window(scores, at, rule, &mut add);
                }
            }
        }
        labels.iter_mut().for_each(|label| *label = label.min(1.0));
        labels
    }
}

fn bell(x: f64, sd: f64) -> f64 {
    (-x * x / (2.0 * sd * sd)).exp()
}

fn gaussian_in_time(scores: &[f64], Peak { at, prominence }: Peak, add: &mut impl FnMut(usize, f64)) {
    let half = scores[at] - 0.5 * prominence;
    let before = scores[..at].iter().rev().take_while(|s| **s >= half).count();
    let after = scores[at + 1..].iter().take_while(|s| **s >= half).count();
    // A Gaussian's full width at half height is 2.355 deviations.
    let sd = ((before + after + 1) as f64 / 2.355).max(1.0);
    (0..scores.len()).for_each(|t| add(t, bell(t as f64 - at as f64, sd)));
}

fn gaussian_in_window(scores: &[f64], at: usize, rule: Rule, add: &mut impl FnMut(usize, f64)) {
    let [rise, fall] = rise_and_fall(scores, at);
    let width = if rule == Rule::Literal { rise.min(fall) } else { rise.max(fall) }.max(1);
    let window = at.saturating_sub(width)..(at + width + 1).min(scores.len());
    let sigma = deviation(&scores[window.clone()]).max(1e-3);
    for t in window {
        let (distance, below) = (t as f64 - at as f64, scores[at] - scores[t]);
        let value = match rule {
            Rule::Score => bell(below, sigma),
            _ if below > sigma => 0.0,
            Rule::Video => bell(2.0 * distance / (scores.len() as f64 - 1.0), sigma),
            Rule::Time | Rule::Literal => bell(distance, sigma),
        };
        add(t, value);
    }
}

/// Population deviation.
fn deviation(x: &[f64]) -> f64 {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    (x.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / n).sqrt()
}

/// A maximum of a curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    /// Its snippet; the first of a plateau.
    pub at: usize,
    /// Height above its surroundings.
    pub prominence: f64,
}

/// Maxima of the five snippets around them, the first of a plateau, that are more than `prominence` above the higher of
/// the lowest scores on both sides, two snippets each.
pub fn window_peaks(s: &[f64], prominence: f64) -> Vec<usize> {
    let lowest = |part: &[f64]| part.iter().copied().fold(f64::INFINITY, f64::min);
    let is_peak = |&i: &usize| {
        let (start, end) = (i.saturating_sub(2), (i + 3).min(s.len()));
        let first = i == 0 || s[i] > s[i - 1];
        first
            && s[start..end].iter().all(|x| *x <= s[i])
            && s[i] - lowest(&s[start..=i]).max(lowest(&s[i..end])) > prominence
    };
    (0..s.len()).filter(is_peak).collect()
}

/// Maxima above `least` whose height above the higher of the two lowest points on the way to higher ground, or to the
/// end of the curve, is more than `prominence`.
pub fn topographic_peaks(s: &[f64], prominence: f64, least: f64) -> Vec<Peak> {
    let peak = |at: usize| {
        let top = s[at];
        let after_plateau = s[at..].iter().find(|x| **x != top);
        if top <= least || (at > 0 && top <= s[at - 1]) || after_plateau.is_some_and(|x| *x > top) {
            return None;
        }
        let valley = |x: &mut dyn Iterator<Item = &f64>| x.take_while(|x| **x <= top).copied().fold(top, f64::min);
        let base = valley(&mut s[..at].iter().rev()).max(valley(&mut s[at + 1..].iter()));
        (top - base > prominence).then_some(Peak { at, prominence: top - base })
    };
    (0..s.len()).filter_map(peak).collect()
}

/// Number of snippets of the strict rise before a peak, and of the strict fall after it.
fn rise_and_fall(s: &[f64], at: usize) -> [usize; 2] {
    let rise = (1..=at).rev().take_while(|t| s[t - 1] < s[*t]).count();
    let fall = (at + 1..s.len()).take_while(|t| s[*t] < s[t - 1]).count();
    [rise, fall]
}
