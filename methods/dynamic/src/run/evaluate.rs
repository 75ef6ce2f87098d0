//! Errors of experts, mixture and reference blends on photos.

use crate::hard_oracle;
use crate::run::mixture::Pictures;
use crate::run::{Run, RunError};
use serde::{Deserialize, Serialize};
use weaver_data::film::Shot;
use weaver_losses::metrics;
use weaver_procedural::MOTIONS;

/// Most training photos in an evaluation, evenly spread.
const TRAINED: usize = 32;
/// Squared errors closer than this are equal.
const EQUAL: f64 = 1e-4;
/// Difference of a channel above which experts differ at a pixel.
const DIFFERENT: f32 = 2.0 / 255.0;

/// Mean PSNR in dB and SSIM.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Quality {
    /// dB.
    pub psnr: f64,
    /// Structural similarity; `None` for photos too small for it.
    pub ssim: Option<f64>,
}

/// Quality of photos of one kind.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Scores {
    /// Number of photos.
    pub shots: usize,
    /// Each expert alone.
    pub experts: Vec<Quality>,
    /// The mean of the experts' pictures.
    pub uniform: Quality,
    /// The mixture.
    pub mixture: Quality,
    /// The expert nearest to the photo at each pixel.
    pub oracle: Quality,
    /// Mean gate of each expert.
    pub shares: Vec<f64>,
    /// Share of the pixels with differing experts at which the gate's first choice is as good as the best expert.
    pub right: f64,
}

/// Quality of pixels that show one kind of motion.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct MotionScores {
    /// The moving part, and its motion.
    pub motion: String,
    /// Number of pixels.
    pub pixels: usize,
    /// PSNR over these pixels, of each expert and of the mixture, dB.
    pub psnr: (Vec<f64>, f64),
    /// Mean gate of each expert.
    pub shares: Vec<f64>,
}

/// Quality of a run on its film.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Evaluation {
    /// The experts' names.
    pub experts: Vec<String>,
    /// Gaussians of each.
    pub gaussians: Vec<usize>,
    /// Photos by held-out cameras, at training times.
    pub held_out_cameras: Option<Scores>,
    /// Photos by training cameras, at held-out times.
    pub held_out_times: Option<Scores>,
    /// Photos by held-out cameras at held-out times.
    pub held_out_both: Option<Scores>,
    /// Training photos.
    pub trained: Option<Scores>,
    /// By kind of motion, over all held-out photos with known motion.
    pub motions: Vec<MotionScores>,
    /// Seconds of each stage.
    pub seconds: Vec<f64>,
}

impl Run {
    /// Evaluates the run on its film; `observe` receives the numbers of finished and of all photos.
    ///
    /// # Errors
    /// When the rasterizer refuses.
    pub fn evaluate(&self, mut observe: impl FnMut(usize, usize)) -> Result<Evaluation, RunError> {
        let shots = |camera: bool, time: bool| -> Vec<&Shot> {
            let asked = |shot: &&Shot| (shot.held_out.camera, shot.held_out.time) == (camera, time);
            self.film.shots.iter().filter(asked).collect()
        };
        let trained = shots(false, false);
        let few = weaver_data::uniform(trained.len(), TRAINED.min(trained.len()));
        let trained: Vec<&Shot> = few.iter().map(|i| trained[*i]).collect();
        let groups = [shots(true, false), shots(false, true), shots(true, true), trained];
        let all: usize = groups.iter().map(Vec::len).sum();
        let experts = self.settings.experts.len();
        let mut motions = vec![MotionSums::new(experts); MOTIONS.len()];
        let mut done = 0;
        let mut scores = Vec::new();
        for (group, shots) in groups.iter().enumerate() {
            let mut sums = Sums::new(experts);
            for shot in shots {
                let pictures = self.mixture.pictures(&self.params, &shot.camera, shot.time)?;
                let photo = shot.image(self.film.size)?.pixels;
                sums.add(&pictures, &photo, self.film.size);
                // Training photos do not measure generalization.
                if let Some(motion) = shot.motion.as_ref().filter(|_| group < 3) {
                    for (kind, sums) in motions.iter_mut().enumerate() {
                        sums.add(&pictures, &photo, |pixel| usize::from(motion[pixel]) == kind);
                    }
                }
                done += 1;
                observe(done, all);
            }
            scores.push((!shots.is_empty()).then(|| sums.mean(shots.len())));
        }
        let seen = motions.into_iter().zip(MOTIONS).filter(|(sums, _)| sums.pixels > 0);
        let mut scores = scores.into_iter();
        let mut next = || scores.next().flatten();
        Ok(Evaluation {
            experts: self.settings.labels(),
            gaussians: self.mixture.counts().to_vec(),
            held_out_cameras: next(),
            held_out_times: next(),
            held_out_both: next(),
            trained: next(),
            motions: seen.map(|(sums, name)| sums.scores(name)).collect(),
            seconds: self.seconds.clone(),
        })
    }
}

/// Sums over photos.
#[derive(Clone, Debug)]
struct Sums {
    scores: Scores,
    /// Number of pixels at which experts differ, and the number of these with a right gate.
    different: [usize; 2],
}

impl Sums {
    fn new(experts: usize) -> Self {
        let scores = Scores { experts: vec![Quality::ZERO; experts], shares: vec![0.0; experts], ..Scores::default() };
        let zeros = Scores { uniform: Quality::ZERO, mixture: Quality::ZERO, oracle: Quality::ZERO, ..scores };
        Self { scores: zeros, different: [0; 2] }
    }

    fn add(&mut self, pictures: &Pictures, photo: &[f32], size: [usize; 2]) {
        let pixels = photo.len() / 3;
        let each: Vec<&[f32]> = pictures.experts.chunks_exact(3 * pixels).collect();
        for (sum, picture) in self.scores.experts.iter_mut().zip(&each) {
            sum.add(picture, photo, size);
        }
        let uniform: Vec<f32> =
            (0..3 * pixels).map(|i| each.iter().map(|picture| picture[i]).sum::<f32>() / each.len() as f32).collect();
        self.scores.uniform.add(&uniform, photo, size);
        self.scores.mixture.add(&pictures.mixture, photo, size);
        let best = hard_oracle(&pictures.experts, photo);
        let chosen: Vec<f32> = (0..3 * pixels).map(|i| each[best[i / 3]][i]).collect();
        self.scores.oracle.add(&chosen, photo, size);
        for (share, gate) in self.scores.shares.iter_mut().zip(pictures.gate.chunks_exact(pixels)) {
            *share += gate.iter().map(|g| f64::from(*g)).sum::<f64>() / pixels as f64;
        }
        for (pixel, best) in best.iter().enumerate() {
            let of = |picture: &[f32]| -> [f32; 3] { std::array::from_fn(|c| picture[3 * pixel + c]) };
            let first = of(each[0]);
            let differ =
                each.iter().any(|picture| of(picture).iter().zip(first).any(|(a, b)| (a - b).abs() > DIFFERENT));
            if !differ {
                continue;
            }
            let gate = |k: usize| pictures.gate[k * pixels + pixel];
            let believed = (0..each.len()).fold(0, |top, k| if gate(k) > gate(top) { k } else { top });
            let error =
                |k: usize| -> f64 { of(each[k]).iter().zip(of(photo)).map(|(a, b)| f64::from(a - b).powi(2)).sum() };
            self.different[0] += 1;
            self.different[1] += usize::from(error(believed) <= error(*best) + EQUAL);
        }
    }

    fn mean(mut self, shots: usize) -> Scores {
        let n = shots as f64;
        let scores = &mut self.scores;
        let qualities = [&mut scores.uniform, &mut scores.mixture, &mut scores.oracle];
        qualities.into_iter().chain(&mut scores.experts).for_each(|quality| quality.divide(n));
        scores.shares.iter_mut().for_each(|share| *share /= n);
        let [different, right] = self.different;
        Scores { shots, right: right as f64 / different.max(1) as f64, ..self.scores }
    }
}

impl Quality {
    const ZERO: Self = Self { psnr: 0.0, ssim: Some(0.0) };
    /// Least sides of photos for a structural similarity, pixels.
    const WINDOW: usize = 11;

    fn add(&mut self, picture: &[f32], photo: &[f32], [height, width]: [usize; 2]) {
        self.psnr += metrics::psnr(picture, photo);
        let planes = |image: &[f32]| -> Vec<f32> {
            (0..3).flat_map(|c| image.iter().skip(c).step_by(3).map(|x| x.clamp(0.0, 1.0))).collect()
        };
        let large = height.min(width) >= Self::WINDOW;
        let similarity = large.then(|| metrics::ssim(&planes(picture), &planes(photo), [3, height, width]));
        self.ssim = self.ssim.zip(similarity).map(|(sum, x)| sum + x);
    }

    fn divide(&mut self, n: f64) {
        self.psnr /= n;
        self.ssim = self.ssim.map(|sum| sum / n);
    }
}

/// Sums over pixels of one kind.
#[derive(Clone, Debug)]
struct MotionSums {
    pixels: usize,
    /// Squared errors of each expert, then of the mixture.
    errors: Vec<f64>,
    shares: Vec<f64>,
}

impl MotionSums {
    fn new(experts: usize) -> Self {
        Self { pixels: 0, errors: vec![0.0; experts + 1], shares: vec![0.0; experts] }
    }

    fn add(&mut self, pictures: &Pictures, photo: &[f32], counts: impl Fn(usize) -> bool) {
        let all = photo.len() / 3;
        let mixture = std::iter::once(&pictures.mixture[..]);
        let each: Vec<&[f32]> = pictures.experts.chunks_exact(3 * all).chain(mixture).collect();
        for pixel in (0..all).filter(|pixel| counts(*pixel)) {
            self.pixels += 1;
            for (sum, picture) in self.errors.iter_mut().zip(&each) {
                *sum += (3 * pixel..3 * pixel + 3)
                    .map(|i| f64::from(picture[i].clamp(0.0, 1.0) - photo[i]).powi(2))
                    .sum::<f64>();
            }
            for (k, share) in self.shares.iter_mut().enumerate() {
                *share += f64::from(pictures.gate[k * all + pixel]);
            }
        }
    }

    fn scores(self, motion: &str) -> MotionScores {
        let n = self.pixels as f64;
        let decibels = |sum: &f64| -10.0 * (sum / (3.0 * n)).log10();
        let mut psnr: Vec<f64> = self.errors.iter().map(decibels).collect();
        let mixture = psnr.pop().unwrap_or(f64::NAN);
        let shares = self.shares.iter().map(|sum| sum / n).collect();
        MotionScores { motion: motion.into(), pixels: self.pixels, psnr: (psnr, mixture), shares }
    }
}
