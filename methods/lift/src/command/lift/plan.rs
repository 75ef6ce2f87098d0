//! Time and memory of lifting, estimated beforehand.

use super::Drawn;
use crate::{Descent, LiftOptions, Solver};
use weaver_command::Failure;
use weaver_geometry::Camera;
use weaver_scene::{CameraRows, Color, GaussianSlices};
use weaver_splat::{Images, Workspace, rasterize};

/// Bytes of an `f32`.
const NUMBER: usize = 4;
/// Bytes of the rasterizer for a Gaussian, and for an entry in the list of a tile, features aside.
const PER_SPLAT: usize = 160;
const PER_ENTRY: usize = 80;

pub struct Plan {
    sizes: String,
    parts: Vec<(&'static str, usize)>,
    passes: String,
}

impl Plan {
    /// Estimates the plan; draws one view for the number of covered tiles.
    pub fn of(drawn: &Drawn, cameras: &[Camera], channels: usize, options: &LiftOptions) -> Result<Self, Failure> {
        let splats = drawn.gaussians.len();
        let block = options.block.min(channels);
        let most = cameras.iter().map(|camera| camera.width * camera.height).max().unwrap_or(0);
        let all: usize = cameras.iter().map(|camera| camera.width * camera.height).sum();
        let entries = entries(drawn, &cameras[cameras.len() / 2])?;
        // Block by block: features, and each solver's further vectors.
        let vectors = match options.solver {
            Solver::Exact { descent: Descent::Iteration, .. } => 2,
            Solver::Exact { .. } | Solver::Damped { .. } => 4,
            _ => 1,
        };
        // Given features and the file's; for solvers that draw also the drawn ones and the difference.
        let copies = if options.solver.draws() { 4 } else { 2 };
        let parts = vec![
            ("features of all Gaussians", NUMBER * splats * channels),
            ("a block of them, and steps", vectors * NUMBER * splats * block),
            ("a view's pixels", NUMBER * (most * (copies * block + 6) + all)),
            ("lists of the rasterizer", entries * (PER_ENTRY + NUMBER * block) + splats * PER_SPLAT),
        ];
        let (views, blocks) = (cameras.len(), channels.div_ceil(block));
        let sizes = format!("{splats} Gaussians, {views} views, {channels} channels in {blocks} blocks");
        let passes = format!("at most {} passes over each view", 1 + options.solver.passes() * blocks);
        Ok(Self { sizes, parts, passes })
    }

    fn bytes(&self) -> usize {
        self.parts.iter().map(|(_, bytes)| bytes).sum()
    }

    pub fn line(&self) -> String {
        format!("lift: {}; about {} of memory", self.sizes, size(self.bytes()))
    }

    pub fn text(&self) -> String {
        let parts = self.parts.iter().map(|(name, bytes)| format!("  {name:<28} {:>9}\n", size(*bytes)));
        format!("{}\n{}\nmemory, about {}:\n{}", self.sizes, self.passes, size(self.bytes()), parts.collect::<String>())
    }

    /// Fails if memory is too small for the plan.
    pub fn check(&self) -> Result<(), Failure> {
        match weaver_io::available_memory() {
            Some(available) if (self.bytes() as u64) > available => Err(Failure::message(format!(
                "memory: expected {} to be available, found {}; a smaller --block or --width reduces it",
                size(self.bytes()),
                size(available as usize)
            ))),
            _ => Ok(()),
        }
    }
}

fn size(bytes: usize) -> String {
    match bytes as f64 {
        b if b < 1e9 => format!("{:.0} MB", (b / 1e6).max(1.0)),
        b => format!("{:.1} GB", b / 1e9),
    }
}

/// Pairs of a Gaussian and a tile in a view.
fn entries(drawn: &Drawn, camera: &Camera) -> Result<usize, Failure> {
    let mut alpha = vec![0.0; camera.width * camera.height];
    let images = Images { image: &mut [], alpha: &mut alpha, depth: None, features: None };
    let gaussians = GaussianSlices { color: Color::None, ..drawn.gaussians.as_slices() };
    let rows = CameraRows::new(std::slice::from_ref(camera));
    let stats = rasterize(&gaussians, &rows.as_slices(&[0.0; 3]), &drawn.settings, &mut Workspace::new(), images)
        .map_err(|e| Failure::message(format!("{}: {e}", drawn.path().display())))?;
    Ok(stats.entries)
}
