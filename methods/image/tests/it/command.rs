//! `splatweaver image`, in this process.

mod bench;
mod kinds;
mod runs;

use clap::Parser;
use std::path::Path;
use weaver_command::{Console, Failure, Interrupt};
use weaver_image::command::{Pictures, run};
use weaver_io::Image;

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    pictures: Pictures,
}

/// Runs a command whose paths are in a folder, marked by `@`, and returns its output, notes included.
fn told_by(folder: &Path, words: &str, interrupt: &Interrupt) -> Result<String, Failure> {
    let here = format!("{}/", folder.display());
    let words = words.split_whitespace().map(|word| word.replace('@', &here));
    let line = Line::try_parse_from(std::iter::once("image".to_string()).chain(words));
    let line = line.map_err(|error| Failure::Usage(error.to_string()))?;
    let (mut out, mut notes) = (Vec::new(), Vec::new());
    let mut console = Console::new(&mut out, &mut notes, false);
    run(&line.pictures, &mut console, interrupt)?;
    Ok(String::from_utf8([notes, out].concat()).unwrap())
}

fn told(folder: &Path, words: &str) -> String {
    told_by(folder, words, &Interrupt::new()).unwrap_or_else(|failure| panic!("{words}: {}", failure.line().unwrap()))
}

fn refused(folder: &Path, words: &str, expected: &str) {
    let message = told_by(folder, words, &Interrupt::new()).unwrap_err().line().unwrap();
    assert!(message.contains(expected), "{words}: {message}");
}

/// A soft picture.
fn wave(width: usize, height: usize, phase: f32) -> Image {
    let value = |x: usize, y: usize, c: usize| 0.5 + 0.3 * (x as f32 * 0.1 + phase + (y * (c + 1)) as f32 * 0.05).sin();
    let pixels = (0..width * height).flat_map(|p| [0, 1, 2].map(|c| value(p % width, p / width, c))).collect();
    Image { width, height, pixels }
}
