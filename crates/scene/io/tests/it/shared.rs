//! Where larger test data lies, on machines that have it.

use std::path::{Path, PathBuf};

/// `shared/data/<name>` in `WEAVER_SHARED`, or beside one of the folders above this crate.
pub fn data(name: &str) -> Option<PathBuf> {
    within("data", name)
}

/// A folder of scenes of 300 Gaussians in several formats, converted by splat-transform.
pub fn samples() -> Option<PathBuf> {
    within("prototypes/formats", "samples")
}

fn within(folder: &str, name: &str) -> Option<PathBuf> {
    let roots = match std::env::var_os("WEAVER_SHARED") {
        Some(root) => vec![PathBuf::from(root)],
        None => Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|a| a.join("shared")).collect(),
    };
    let found = roots.into_iter().map(|r| r.join(folder).join(name)).find(|p| p.exists());
    if found.is_none() {
        println!("skipped: no data ({name})");
    }
    found
}
