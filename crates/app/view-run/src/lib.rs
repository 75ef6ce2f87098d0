//! Scenes on disk to look at in a browser.
//!
//! A [`ScenePage`] is a scene with its cameras and photos. It becomes one file ([`ScenePage::html`]) or is shown by a
//! [`Server`], which may follow a run that is under way ([`LiveRun`]).

mod error;
mod features;
mod follow;
#[cfg(feature = "command")]
mod live;
mod overview;
mod scene_page;
mod server;

pub use error::Error;
pub use features::Features;
pub use follow::{DrawingOf, FilmOf, LiveRun, LiveView, SceneOf};
#[cfg(feature = "command")]
pub use live::live;
pub use overview::overview;
pub use scene_page::{Gallery, Moving, ScenePage};
pub use server::{Access, Listener, Server};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
