//! A scene that a command shows: as one file, or by a server until it is interrupted.

use crate::{Listener, ScenePage, Server};
use std::path::Path;
use std::process::{Command, Stdio};
use weaver_command::{Console, Failure, Interrupt};
use weaver_io::write_text;
use weaver_view::HtmlOptions;

/// Megabytes of a page above which there is a warning.
const LARGE: f64 = 60.0;
/// Megabytes of a page above which it is written only by request.
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
    /// Writes the file even if it has more than 200 MB.
    pub any_size: bool,
}

impl PageFile<'_> {
    /// Writes the page of a scene, and opens it if so requested.
    ///
    /// # Errors
    /// When the page is too large, or cannot be written.
    pub fn write(&self, page: &ScenePage, opened: bool, console: &mut Console) -> Result<(), Failure> {
        let text = match &page.moving {
            Some(_) => page.film_html(self.moments, self.options)?,
            None => page.html(self.options)?,
        };
        let (megabytes, file) = (text.len() as f64 / 1e6, self.path.display());
        match weighed(megabytes, self.any_size) {
            Weight::Small => {}
            Weight::Large => {
                console.warning(&format!("the page has {megabytes:.0} MB, more than phones may open"));
            }
            Weight::TooLarge => {
                return Err(Failure::message(format!(
                    "{file}: the page has {megabytes:.0} MB, which many browsers do not open; --yes writes it all the same, `splatweaver view` without --html needs no file"
                )));
            }
        }
        write_text(self.path, &text)?;
        if opened {
            open(&file.to_string(), console);
        }
        console.print(&format!("page: {} Gaussians, {megabytes:.1} MB, in {file}", page.gaussians.len()))
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

/// Judgment of the size of a page.
#[derive(Debug, PartialEq, Eq)]
enum Weight {
    Small,
    Large,
    TooLarge,
}

fn weighed(megabytes: f64, any_size: bool) -> Weight {
    if megabytes > TOO_LARGE && !any_size {
        Weight::TooLarge
    } else if megabytes > LARGE {
        Weight::Large
    } else {
        Weight::Small
    }
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

    /// Large pages are warned of and larger ones need a word.
    #[test]
    fn large_pages_are_warned_of() {
        let weights = [(59.0, false), (61.0, false), (199.0, false), (201.0, false), (201.0, true)]
            .map(|(mb, yes)| weighed(mb, yes));
        assert_eq!(weights, [Weight::Small, Weight::Large, Weight::Large, Weight::TooLarge, Weight::Large]);
    }
}
