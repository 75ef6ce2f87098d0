//! Scenes on disk to look at in a browser.
//!
//! A [`ScenePage`] is a scene with its cameras and photos. It becomes one file ([`ScenePage::html`]) or is shown by a
//! [`Server`], which may follow a run that is under way ([`LiveRun`]).

mod error;
mod features;
mod follow;
#[cfg(feature = "command")]
mod live;
mod notes_file;
mod overview;
#[cfg(feature = "command")]
mod scene_files;
mod scene_page;
mod server;
#[cfg(feature = "command")]
mod show;

pub use error::Error;
pub use features::Features;
pub use follow::{DrawingOf, FilmOf, LiveRun, LiveView, SceneOf};
#[cfg(feature = "command")]
pub use live::live;
pub use notes_file::notes_file;
pub use overview::overview;
#[cfg(feature = "command")]
pub use scene_files::SceneFiles;
pub use scene_page::{Gallery, Moving, ScenePage};
pub use server::{Access, Listener, Server};
#[cfg(feature = "command")]
pub use show::{PageFile, serve};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
