//! Structure from motion: cameras and points from photos, by features and least squares.
//!
//! - [`Features`]: keypoints of a photo and their descriptors. [`matches()`]: matches between two photos. [`tracks`]:
//!   matches joined over many photos.
//! - [`candidates`]: pairs among thousands of photos that may show the same things; [`expansion`]: further pairs after
//!   a first round.
//! - [`two_view`]: the relative pose of two cameras, from matches.
//! - [`Bundle`]: cameras, lenses and points adjusted to all observations.
//! - [`estimate()`]: all of it for photos without any other information.
//! - [`estimate_with`]: the same, and a second look with a [`PairMatcher`] where own features leave photos out or
//!   cameras in doubt. [`LearnedMatcher`] is one: learned features and a learned matcher; the caller reads its weights.
//! - [`estimate_fisheye`]: the same for photos of a fisheye, whose lens is found, too.
//! - [`refine`]: all of it for cameras that are nearly right.
//!
//! The same bits at any number of threads.

mod align;
mod bundle;
mod confidence;
mod descriptor;
mod epipolar;
mod estimate;
mod evidence;
mod features;
mod fisheye;
mod focal;
mod grow;
mod learned;
mod lenses;
mod locate;
mod matching;
mod minimal;
mod observe;
mod pairs;
mod passes;
mod photo;
mod place;
mod refine;
mod retrieval;
mod scale_space;
mod search;
mod second_look;
mod ties;
mod tracks;
mod triangulation;
mod turning;
mod two_view;
mod uncertainty;

pub use bundle::{Bundle, Covariance, Lens, Mounted, Observation, Solved};
pub use confidence::Confidence;
pub use descriptor::DESCRIPTOR;
pub use epipolar::Epipolar;
pub use estimate::{Estimate, LeftOut, estimate, estimate_from, estimate_with};
pub use features::{Features, Keypoint};
pub use fisheye::{FisheyeLens, estimate_fisheye};
pub use learned::{FoundTensor, LEARNED_DESCRIPTOR, LearnedFeatures, LearnedMatch, LearnedMatcher, WeightsFault};
pub use matching::{Match, matches, matches_along};
pub use photo::{EstimateOptions, Find, Photo};
pub use refine::{RefineSettings, Refined, View, carried, refine};
pub use retrieval::{candidates, expansion};
pub use second_look::PairMatcher;
pub use tracks::{Track, tracks};
pub use two_view::{TwoView, rotation_only, two_view};
pub use uncertainty::Uncertainty;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
