//! Gaussians that move: four models of motion, each a complete representation of a dynamic scene, behind one trait.
//!
//! [`Field`], [`Code`], [`Keys`] and [`Poly`] are the experts that MoE-GS (Jin et al., arXiv 2510.19210) mixes. Each is
//! a file that follows its own paper; [`Motion`] is their common trait, and [`Expert`] one of them with colors.
//! [`PixelRouter`] weights several frozen experts at each pixel ([`Seen`] caches renders for its training), [`scores`]
//! ranks their Gaussians for pruning. [`hard_oracle`] is an upper bound on any choice of experts.

mod best_expert;
#[cfg(feature = "command")]
pub mod command;
mod expert;
mod motion;
mod plane_sample;
mod pruning;
mod router;
#[cfg(feature = "command")]
pub mod run;
mod seen;

pub use best_expert::hard_oracle;
pub use expert::Expert;
pub use motion::code::{Code, CodeConfig};
pub use motion::field::{Field, FieldConfig};
pub use motion::keys::{Drift, Keys, KeysConfig};
pub use motion::poly::Poly;
pub use motion::{Motion, Moved, Start};
pub use plane_sample::plane_sample;
pub use pruning::{Drawn, Score, best, scores};
pub use router::{Gated, PixelRouter, RouterConfig, distillation, photometric};
pub use seen::{Seen, Shot};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
