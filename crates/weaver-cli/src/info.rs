//! `splatweaver info`.

use crate::Console;
use crate::arguments::Info;
use crate::failure::Failure;

pub fn run(arguments: &Info, console: &mut Console) -> Result<(), Failure> {
    console.print(&weaver_io::info(&arguments.file)?)
}
