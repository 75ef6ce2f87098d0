//! The `splatweaver` binary.

use std::process::ExitCode;

fn main() -> ExitCode {
    weaver_cli::process(std::env::args_os()).into()
}
