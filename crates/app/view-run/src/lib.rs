//! Scenes on disk to look at in a browser.
//!
//! An [`Exhibit`] is a scene with its cameras and photos. It becomes one file ([`Exhibit::html`]) or is shown by a [`Server`], which may
//! follow a run that is under way ([`Followed`]).

mod error;
mod exhibit;
mod features;
mod follow;
#[cfg(feature = "command")]
mod live;
mod server;

pub use error::Error;
pub use exhibit::{Exhibit, Gallery, Moving};
pub use features::Features;
pub use follow::{DrawingOf, FilmOf, Followed, SceneOf, Showing};
#[cfg(feature = "command")]
pub use live::live;
pub use server::{Listener, Server, Visitors};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
