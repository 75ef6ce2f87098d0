//! Trains on planted anomalies for some seconds and judges the detector: `planted FOLDER`.

use clap::Parser;
use weaver_command::{Console, Interrupt};
use weaver_vad::command::{Vad, run};

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    vad: Vad,
}

fn main() {
    let folder = std::env::args().nth(1).unwrap_or_else(|| "runs/planted".into());
    let line = Line::parse_from(["vad", "train", "--encoder", "convolutions", "--out", &folder]);
    let (mut out, mut notes) = (std::io::stdout(), std::io::stderr());
    let mut console = Console::new(&mut out, &mut notes, false);
    if let Err(failure) = run(&line.vad, &mut console, &Interrupt::new()) {
        eprintln!("{}", failure.line().unwrap_or_default());
    }
}
