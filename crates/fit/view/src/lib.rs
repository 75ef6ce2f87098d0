//! Scenes of Gaussians to look at in a browser.
//!
//! [`html`] makes one file that holds scene, cameras, photos and viewer. It draws by WebGL2 as the rasterizer of
//! weaver-splat does.

mod error;
mod home;
mod modules;
mod notes;
mod page;
mod run_page;
mod subject;
mod template;

pub use error::ViewError;
pub use notes::{InvalidNotes, Notes};
pub use page::{HtmlOptions, ServedPage, film_html, html};
pub use run_page::RunPage;
pub use subject::{Look, Shot, Subject, photo_file, pictured};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
