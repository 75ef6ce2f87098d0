//! `splatweaver image` by itself: `pictures fit | draw | bench ..`.

use clap::Parser;
use weaver_command::{Console, Interrupt};
use weaver_image::command::{Pictures, run};

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    pictures: Pictures,
}

fn main() {
    let line = Line::parse();
    let (mut out, mut notes) = (std::io::stdout(), std::io::stderr());
    let mut console = Console::new(&mut out, &mut notes, false);
    if let Err(failure) = run(&line.pictures, &mut console, &Interrupt::new()) {
        eprintln!("{}", failure.line().unwrap_or_default());
        std::process::exit(failure.exit_code().into());
    }
}
