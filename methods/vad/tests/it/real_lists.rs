//! Annotations that are not part of the repository.

use std::path::PathBuf;

/// The folder of the real annotation lists, if present.
pub fn real_lists() -> Option<PathBuf> {
    let root = std::env::var_os("WEAVER_SHARED").map(PathBuf::from);
    let folder = root.map(|root| root.join("data/video-anomaly-labels")).filter(|folder| folder.is_dir());
    if folder.is_none() {
        println!("skipped: no data (video-anomaly-labels)");
    }
    folder
}
