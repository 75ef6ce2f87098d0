//! Files of a scene by other programs.

use super::table::Coded;
use std::path::PathBuf;
use std::time::Instant;
use weaver_command::Failure;
use weaver_io::{SceneFormat, read_scene};
use weaver_scene::Gaussians;

/// Formats with scenes of several files, for which the size of one file is not the scene's.
const SEVERAL: [&str; 2] = ["sog-folder", "gltf"];

/// A file by another program.
pub struct Peer {
    pub name: String,
    pub gaussians: Gaussians,
    bytes: u64,
    /// Seconds of reading.
    seconds: f64,
}

impl Peer {
    /// Its bytes, with their source.
    pub fn result(&self) -> Coded {
        let seconds = [None, Some(self.seconds)];
        Coded { method: self.name.clone(), setting: String::new(), bytes: self.bytes, seconds }
    }
}

/// Reads the files, all of one scene.
pub fn read(peers: &[PathBuf], scenes: &[PathBuf]) -> Result<Vec<Peer>, Failure> {
    if !peers.is_empty() && scenes.len() != 1 {
        return Err(Failure::Usage(format!("--peer: expected one SCENE, found {}", scenes.len())));
    }
    peers.iter().map(one).collect()
}

fn one(path: &PathBuf) -> Result<Peer, Failure> {
    let format = SceneFormat::of(path)?;
    if SEVERAL.contains(&format.name) {
        let expected = "expected a format of one file, whose size counts";
        return Err(Failure::Usage(format!("--peer: {}: {expected}, found {format}", path.display())));
    }
    let start = Instant::now();
    let gaussians = read_scene(path)?.gaussians;
    let seconds = start.elapsed().as_secs_f64();
    let bytes =
        std::fs::metadata(path).map_err(|error| Failure::message(format!("{}: {error}", path.display())))?.len();
    Ok(Peer { name: path.display().to_string(), gaussians, bytes, seconds })
}
