//! A scene that a command shows: as one file, or by a server until it is interrupted.

use crate::{Listener, ScenePage, Server};
use std::path::Path;
use std::process::{Command, Stdio};
use weaver_command::{Console, Failure, Interrupt};
use weaver_io::write_text;
use weaver_scene::Gaussians;
use weaver_view::HtmlOptions;

/// Megabytes of a page above which there is a warning.
const LARGE: f64 = 60.0;
/// Megabytes of a page above which it has fewer Gaussians, unless it is to have all.
const TOO_LARGE: f64 = 200.0;

/// One HTML file of a scene.
#[derive(Clone, Copy, Debug)]
pub struct PageFile<'a> {
    /// The file.
    pub path: &'a Path,
    /// Rounding of the scene.
    pub options: HtmlOptions,
    /// Moments of a moving scene, evenly spread over the film.
    pub moments: usize,
    /// Writes all Gaussians, even if the file has more than 200 MB.
    pub any_size: bool,
}

impl PageFile<'_> {
    /// Writes the page of a scene, and opens it if so requested. Of a scene that does not move, neighbors are
    /// [merged](weaver_scene::Gaussians::merged) until the page has at most 200 MB.
    ///
    /// # Errors
    /// When a page without fewer Gaussians is too large, or it cannot be written.
    pub fn write(&self, page: &ScenePage, opened: bool, console: &mut Console) -> Result<(), Failure> {
        let (text, gaussians) = self.text(page, if self.any_size { f64::INFINITY } else { TOO_LARGE })?;
        let (megabytes, file) = (text.len() as f64 / 1e6, self.path.display());
        if gaussians < page.gaussians.len() {
            let all = page.gaussians.len();
            console.warning(&format!(
                "{file}: {all} Gaussians are merged to {gaussians}, because many browsers do not open pages of more than {TOO_LARGE} MB; --yes writes all, `splatweaver view` without --html shows all"
            ));
        }
        if megabytes > LARGE {
            console.warning(&format!("the page has {megabytes:.0} MB, more than phones may open"));
        }
        write_text(self.path, &text)?;
        if opened {
            open(&file.to_string(), console);
        }
        console.print(&format!("page: {gaussians} Gaussians, {megabytes:.1} MB, in {file}"))
    }

    /// A page of at most so many megabytes, and its number of Gaussians.
    fn text(&self, page: &ScenePage, most: f64) -> Result<(String, usize), Failure> {
        let megabytes = |text: &String| text.len() as f64 / 1e6;
        if page.moving.is_some() {
            let text = page.film_html(self.moments, self.options)?;
            return if megabytes(&text) > most {
                Err(self.too_large(megabytes(&text)))
            } else {
                Ok((text, page.gaussians.len()))
            };
        }
        let mut text = page.html(self.options)?;
        if megabytes(&text) <= most {
            return Ok((text, page.gaussians.len()));
        }
        // Photos and the page itself take the same room whatever the number.
        let mut fewer = ScenePage { gaussians: Gaussians::default(), ..page.clone() };
        let empty = megabytes(&fewer.html(self.options)?);
        if empty >= most {
            return Err(self.too_large(megabytes(&text)));
        }
        fewer.gaussians = page.gaussians.clone();
        while megabytes(&text) > most {
            let share = 0.98 * (most - empty) / (megabytes(&text) - empty);
            let count = (share * fewer.gaussians.len() as f64) as usize;
            let merged = fewer.gaussians.merged(count);
            if merged.len() == fewer.gaussians.len() {
                return Err(self.too_large(megabytes(&text)));
            }
            fewer.gaussians = merged;
            text = fewer.html(self.options)?;
        }
        Ok((text, fewer.gaussians.len()))
    }

    fn too_large(&self, megabytes: f64) -> Failure {
        let file = self.path.display();
        Failure::message(format!(
            "{file}: the page has {megabytes:.0} MB, which many browsers do not open; --yes writes it all the same, `splatweaver view` without --html needs no file"
        ))
    }
}

/// Serves a scene until it is interrupted, and opens it in the browser if so requested.
///
/// # Errors
/// When the server cannot begin, or the output is closed.
pub fn serve(
    page: &ScenePage,
    listener: Listener,
    opened: bool,
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let server = Server::new(page, None, listener)?;
    // First, for it opens here as well.
    if let Some(address) = server.network_address() {
        console.print(&address)?;
    }
    console.print(&server.address())?;
    console.note("Ctrl-C ends the server");
    if opened {
        open(&server.address(), console);
    }
    server.run(interrupt.watch());
    Ok(())
}

/// Lets the desktop open an address or a file.
fn open(address: &str, console: &mut Console) {
    let program = if cfg!(target_os = "macos") {
        "open"
    } else if cfg!(windows) {
        "explorer"
    } else {
        "xdg-open"
    };
    let mut command = Command::new(program);
    let quiet = command.arg(address).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    if quiet.spawn().is_err() {
        console.note(&format!("note: found no {program}, which would open the page"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Promise (scenes): a page that would be too large shows merged Gaussians.
    #[test]
    fn large_pages_show_merged_gaussians() {
        let gaussians = Gaussians {
            means: (0..4000).map(|i| [(i % 63) as f32, (i / 63) as f32, (i % 7) as f32]).collect(),
            log_scales: vec![[-1.0; 3]; 4000],
            quats: vec![[1.0, 0.0, 0.0, 0.0]; 4000],
            opacity_logits: (0..4000).map(|i| (i as f32).sin()).collect(),
            sh: (0..12_000).map(|i| (i as f32).cos()).collect(),
            degree: 0,
        };
        let page = ScenePage::new("scene", gaussians, Default::default());
        let options = HtmlOptions { lossless: true };
        let file = PageFile { path: "a.html".as_ref(), options, moments: 2, any_size: false };
        let megabytes = |(text, _): &(String, usize)| text.len() as f64 / 1e6;
        let whole = file.text(&page, f64::INFINITY).unwrap();
        assert_eq!(whole.1, 4000);
        let most = megabytes(&whole) - 0.03;
        let smaller = file.text(&page, most).unwrap();
        assert!(megabytes(&smaller) <= most && smaller.1 < 4000 && smaller.1 > 1000, "{}", smaller.1);
        assert!(file.text(&page, 0.01).unwrap_err().line().unwrap().contains("--yes"));
        let moving = crate::Moving::new(|_| Gaussians::default());
        assert!(file.text(&ScenePage { moving: Some(moving), ..page }, 0.01).is_err());
    }
}
