//! `splatweaver convert`.

use crate::arguments::Convert;
use weaver_command::{Console, Failure};
use weaver_io::{SceneFormat, check_output_file, file_length, read_gaussians, write_gaussians};

pub fn run(arguments: &Convert, console: &mut Console) -> Result<(), Failure> {
    let format = SceneFormat::of(&arguments.to)?;
    check_output_file(&arguments.to, [&arguments.from])?;
    let gaussians = read_gaussians(&arguments.from)?;
    write_gaussians(&arguments.to, &gaussians)?;
    let (count, bytes) = (gaussians.len(), file_length(&arguments.to)? as f64);
    let kept = format.keeps;
    console.print(&format!("{count} Gaussians, {:.1} MB, {kept}: {}", bytes / 1e6, arguments.to.display()))
}
