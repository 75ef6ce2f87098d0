//! Pages in files.

use tempfile::TempDir;
use weaver_scene::Gaussians;
use weaver_view::{HtmlOptions, Look, Shot, Subject, film_html, html};

pub struct Written {
    folder: TempDir,
}

impl Written {
    /// Writes a page of this text.
    pub fn text(text: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("view.html"), text).unwrap();
        Self { folder }
    }

    pub fn page(gaussians: &Gaussians, look: Look, shots: &[Shot], lossless: bool) -> Self {
        let subject = Subject { title: "scene", gaussians, look, notes: None, second: None };
        Self::text(&html(&subject, shots, HtmlOptions { lossless }).unwrap())
    }

    /// Writes a page of a scene and a second one with its name.
    pub fn both(gaussians: &Gaussians, second: (&str, &Gaussians)) -> Self {
        let subject = Subject { title: "a.ply", gaussians, look: Look::default(), notes: None, second: Some(second) };
        Self::text(&html(&subject, &[], HtmlOptions::default()).unwrap())
    }

    /// Writes a page of a scene that moves, which begins with the first of its moments.
    pub fn film(moments: &[Gaussians]) -> Self {
        let subject =
            Subject { title: "film", gaussians: &moments[0], look: Look::default(), notes: None, second: None };
        Self::text(&film_html(&subject, moments, &[], HtmlOptions::default()).unwrap())
    }

    pub fn address(&self) -> String {
        format!("file://{}/view.html", self.folder.path().display())
    }
}
