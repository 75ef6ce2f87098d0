//! Held-out views in the light of a photo: the choice of the photo, the part of it that the model sees, and figures of
//! the light.

use super::Options;
use crate::figures::LookFigures;
use std::fmt;
use std::str::FromStr;
use weaver_data::{Scene, Tuple, View};
use weaver_inference::{Photos, planar};
use weaver_io::Image;
use weaver_procedural::appearance::{keep_columns, seen};

/// The photo in whose light a held-out view is drawn. All figures are then of the view's right half, for every choice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LookOf {
    /// The light of the left half of the held-out photo, all that the model sees of it: the right half is filled with
    /// the left's mean.
    Half,
    /// The light of the whole held-out photo, which the model has then seen.
    Own,
    /// No photo's light: the embedding is zero.
    Unknown,
    /// The light of another photo of the scene, taken in other light: the next held-out one.
    Wrong,
}

impl LookOf {
    /// All of them with their names.
    const ALL: [(Self, &'static str); 4] =
        [(Self::Half, "half"), (Self::Own, "own"), (Self::Unknown, "none"), (Self::Wrong, "wrong")];
}

impl fmt::Display for LookOf {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let named = Self::ALL.iter().find(|(look, _)| look == self);
        f.write_str(named.map_or("", |(_, name)| name))
    }
}

impl FromStr for LookOf {
    type Err = String;
    fn from_str(s: &str) -> Result<Self, String> {
        let named = Self::ALL.iter().find(|(_, name)| *name == s);
        named.map(|(look, _)| *look).ok_or_else(|| format!("expected half, own, none or wrong, found `{s}`"))
    }
}

/// The photo that gives the light of a tuple's target, as planes `[3, H, W]`; `None` for [`LookOf::Unknown`].
pub(super) fn photo_of(look: LookOf, scene: &Scene, tuple: &Tuple) -> Option<Vec<f32>> {
    let target = tuple.targets[0];
    let view = match look {
        LookOf::Unknown => return None,
        LookOf::Own | LookOf::Half => target,
        LookOf::Wrong => {
            let others = scene.held_out_views();
            let next = others.iter().chain(&others).skip_while(|view| **view != target).nth(1);
            next.copied().filter(|view| *view != target).unwrap_or(tuple.context[0])
        }
    };
    let image = &scene.views[view].image;
    let mut all = planar([image]);
    if look == LookOf::Half {
        let planes = all.chunks_mut(image.width * image.height);
        planes.for_each(|plane| keep_columns(plane, image.width, 0..image.width / 2));
    }
    Some(all)
}

/// One photo in the layout of the networks.
pub(super) fn as_photos(planes: &[f32], size: [usize; 2]) -> Photos<'_> {
    Photos { planes, inside: None, width: size[0], height: size[1] }
}

/// The target of a tuple with the pixels that figures count: with planted looks, pixels that context photos show as
/// well; with a chosen light, the right half alone.
pub(super) fn judged(scene: &Scene, tuple: &Tuple, options: &Options) -> View {
    let mut view = scene.views[tuple.targets[0]].clone();
    let [width, pixels] = [view.image.width, view.image.width * view.image.height];
    if options.planted.is_some() {
        let counts =
            |i: usize, at: usize| scene.views[tuple.context[i]].inside.as_ref().is_none_or(|inside| inside[at]);
        let shared = seen(scene, tuple.targets[0], &tuple.context, counts);
        let inside = view.inside.get_or_insert_with(|| vec![true; pixels]);
        shared.iter().flatten().zip(inside).for_each(|(seen, inside)| *inside &= seen);
    }
    if options.look.is_some() {
        let inside = view.inside.get_or_insert_with(|| vec![true; pixels]);
        inside.iter_mut().enumerate().filter(|(i, _)| i % width < width / 2).for_each(|(_, inside)| *inside = false);
    }
    view
}

/// Values of one channel of an image where a view's pixels count.
fn counted<'a>(image: &'a Image, view: &'a View, channel: usize) -> impl Iterator<Item = f64> + 'a {
    let inside = |i: usize| view.inside.as_ref().is_none_or(|inside| inside[i]);
    let values = image.pixels.chunks_exact(3).enumerate().filter(move |(i, _)| inside(*i));
    values.map(move |(_, color)| f64::from(color[channel]))
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), x| (sum + x, count + 1.0));
    sum / count
}

/// Figures of a render's light beside a photo's.
pub(super) fn figures(render: &Image, view: &View) -> LookFigures {
    let (mut squares, mut color_error) = (0.0, 0.0);
    for channel in 0..3 {
        let shown: Vec<f64> = counted(render, view, channel).collect();
        let truth: Vec<f64> = counted(&view.image, view, channel).collect();
        let [of_shown, of_truth] = [&shown, &truth].map(|values| mean(values.iter().copied()));
        color_error += (of_shown - of_truth).abs() / 3.0;
        let pairs = || shown.iter().zip(&truth).map(|(s, t)| (s - of_shown, t - of_truth));
        let spread: f64 = pairs().map(|(s, _)| s * s).sum();
        let gain = if spread > 0.0 { pairs().map(|(s, t)| s * t).sum::<f64>() / spread } else { 0.0 };
        squares += mean(pairs().map(|(s, t)| (gain * s - t).powi(2))) / 3.0;
    }
    LookFigures { psnr_fitted: -10.0 * squares.log10(), color_error, slope: None, correlation: None }
}

/// Agreement between changes of the renders' mean color and of the photos' mean color, over the views of a scene.
#[derive(Debug, Default)]
pub(super) struct Recovery {
    /// For each channel, log ratios of photo and of render.
    ratios: [Vec<[f64; 2]>; 3],
}

impl Recovery {
    /// Adds a view: its photos and its renders in two lights.
    pub fn add(&mut self, photos: [&Image; 2], renders: [&Image; 2], view: &View) {
        for (channel, ratios) in self.ratios.iter_mut().enumerate() {
            let ratio = |[a, b]: [&Image; 2]| {
                let [a, b] = [a, b].map(|image| mean(counted(image, view, channel)));
                (a.max(1e-4) / b.max(1e-4)).ln()
            };
            let both = [ratio(photos), ratio(renders)];
            if both.iter().all(|x| x.is_finite()) {
                ratios.push(both);
            }
        }
    }

    /// Slope and correlation of renders by photos, where there are views enough.
    pub fn slope_and_correlation(&self) -> Option<[[f64; 3]; 2]> {
        let fit = |ratios: &Vec<[f64; 2]>| -> Option<[f64; 2]> {
            if ratios.len() < 3 {
                return None;
            }
            let [x, y] = [0, 1].map(|axis| mean(ratios.iter().map(|r| r[axis])));
            let sum = |f: &dyn Fn(f64, f64) -> f64| ratios.iter().map(|r| f(r[0] - x, r[1] - y)).sum::<f64>();
            let [xx, xy, yy] = [sum(&|x, _| x * x), sum(&|x, y| x * y), sum(&|_, y| y * y)];
            (xx > 0.0).then(|| [xy / xx, if yy > 0.0 { xy / (xx * yy).sqrt() } else { 0.0 }])
        };
        let [r, g, b] = [0, 1, 2].map(|channel| fit(&self.ratios[channel]));
        let [r, g, b] = [r?, g?, b?];
        Some([[r[0], g[0], b[0]], [r[1], g[1], b[1]]])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back() {
        for (look, name) in LookOf::ALL {
            assert_eq!((name.parse(), look.to_string()), (Ok(look), name.to_string()));
        }
        assert!("left".parse::<LookOf>().unwrap_err().contains("found `left`"));
    }

    #[test]
    fn slopes_are_those_of_the_ratios() {
        let recovery = Recovery { ratios: [0, 1, 2].map(|_| [[-1.0, -0.5], [0.0, 0.0], [2.0, 1.0]].to_vec()) };
        let [slope, correlation] = recovery.slope_and_correlation().unwrap();
        assert!(slope.iter().all(|s| (s - 0.5).abs() < 1e-12) && correlation.iter().all(|c| (c - 1.0).abs() < 1e-12));
        assert_eq!(Recovery::default().slope_and_correlation(), None);
    }
}
