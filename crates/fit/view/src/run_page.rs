//! The page about a run without a scene.

use crate::modules;
use crate::page::{STYLE, served_policy};
use crate::template::{escape, fill};

const PAGE: &str = include_str!("../web/run.html");

/// A page that a server sends about a run without a scene: its steps, its curves and its newest picture.
///
/// It requests `progress?since=STEP`, `picture` and `POST stop`.
///
/// ```
/// let page = weaver_view::RunPage { title: "run <7>", nonce: "0f" };
/// assert!(page.html().contains("<h1>run &lt;7&gt;</h1>"));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct RunPage<'a> {
    /// Title of the page; any text.
    pub title: &'a str,
    /// A word that cannot be guessed, in this page and in its content security policy.
    pub nonce: &'a str,
}

impl RunPage<'_> {
    /// The page as HTML.
    pub fn html(&self) -> String {
        let (title, script) = (escape(self.title), modules::run());
        fill(PAGE, &[("title", &title), ("style", STYLE), ("nonce", self.nonce), ("script", &script)])
    }

    /// The content security policy of the page, for the header of the answer.
    pub fn policy(&self) -> String {
        served_policy(self.nonce)
    }
}
