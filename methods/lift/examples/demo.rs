//! The solvers on built-in scenes of given seeds, with known truth.

use clap::Parser;
use weaver_command::Console;
use weaver_lift::command::{Lift, lift};

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    lift: Lift,
}

fn main() {
    let seeds: Vec<String> = std::env::args().skip(1).collect();
    let line = Line::parse_from(["demo", "--demo"].into_iter().chain(seeds.iter().map(String::as_str)));
    let (mut stdout, mut stderr) = (std::io::stdout(), std::io::stderr());
    let mut console = Console::new(&mut stdout, &mut stderr, false);
    if let Err(failure) = lift(&line.lift, &mut console) {
        eprintln!("error: {}", failure.line().unwrap_or_default());
    }
}
