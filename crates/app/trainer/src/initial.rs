//! The weights that a run starts from, where they are not random.

use crate::Error;
use std::path::Path;
use weaver_autograd::Params;
use weaver_inference::published::Opened;
use weaver_inference::{Checkpoint, Partly, is_of_run};

/// In place of a file: the weights that come with the program.
pub const BUILT_IN: &str = "built-in";
/// Names that a remark lists of each kind.
const LISTED: usize = 20;

/// Takes the fitting parameters of a checkpoint, the averaged weights of a run or published ones, and returns a remark
/// that counts them.
///
/// Models of different kinds may share parts: parameters are matched by name.
///
/// # Errors
/// When the checkpoint cannot be read, or has nothing that fits.
pub fn weights(path: &Path, params: &mut Params<f32>) -> Result<String, Error> {
    let Partly { taken, fresh, unused } = if path == Path::new(BUILT_IN) {
        Checkpoint::built_in()?.fill_partly(params)?
    } else if is_of_run(path)? {
        Checkpoint::read(path)?.fill_partly(params)?
    } else {
        Opened::new(path, true)?.fill_partly(params)?
    };
    let of = taken.len() + fresh.len();
    let mut text = format!("weights of {}: {} of {of} parameters taken", path.display(), taken.len());
    for (what, names) in [("random", fresh), ("of the checkpoint not taken", unused)] {
        if !names.is_empty() {
            let shown = names.iter().take(LISTED).map(String::as_str).collect::<Vec<_>>().join(", ");
            let more = if names.len() > LISTED { ", ..." } else { "" };
            text.push_str(&format!("; {} {what}: {shown}{more}", names.len()));
        }
    }
    Ok(text)
}
