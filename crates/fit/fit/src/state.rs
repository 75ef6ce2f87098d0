//! The state of a fit from which it goes on.

use crate::exposure::Exposure;
use crate::fit::Fit;
use crate::population::{Field, Population};
use crate::transients::Transients;
use weaver_geometry::Pose;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::sh::{MAX_DEGREE, coefficients};
use weaver_io::safetensors::{Element, Tensors};
use weaver_io::{Error, Result};
use weaver_scene::Gaussians;
use weaver_splat::GaussianStatistics;

/// Numbers of a row of statistics.
const STATISTICS: usize = 6;
/// Numbers of a row of poses: rotation, translation.
const POSE: usize = 9 + 3;
/// Cells of transients in a number.
const WORD: usize = 64;
/// Numbers of a row of exposures: matrix, two moments, steps.
const EXPOSURE: usize = 3 * 12 + 1;

impl Fit {
    /// The whole state of a fit: with the same photos and settings, a fit that [`restore`](Self::restore)s it goes on
    /// to the same bits as an uninterrupted one.
    ///
    /// # Panics
    /// As [`population`](Self::population).
    pub fn state(&self) -> Tensors {
        let mut state = Tensors::default();
        fn put<E: Element>(state: &mut Tensors, name: &str, width: usize, values: Vec<E>) {
            state.insert(name, &[values.len() / width, width], values);
        }
        for (name, field) in self.population().fields() {
            for (part, values) in [("values", &field.values), ("first", &field.first), ("second", &field.second)] {
                put(&mut state, &format!("{name}.{part}"), field.width(), values.clone());
            }
        }
        put(&mut state, "statistics", STATISTICS, self.statistics.iter().flat_map(statistics_row).collect());
        put(&mut state, "exposures", EXPOSURE, self.exposures.iter().flat_map(exposure_row).collect());
        put(&mut state, "poses", POSE, self.poses.iter().flat_map(pose_row).collect());
        let found = (0..).zip(&self.transients).filter_map(|(photo, found)| Some((photo, found.as_ref()?)));
        let (mut sizes, mut hidden) = (Vec::new(), Vec::new());
        for (photo, Transients { size: [width, height], hidden: own }) in found {
            sizes.extend([photo, *width as u64, *height as u64]);
            let bits = |cells: &[bool]| cells.iter().rev().fold(0, |bits, hidden| bits << 1 | u64::from(*hidden));
            hidden.extend(own.chunks(WORD).map(bits));
        }
        put(&mut state, "transients.sizes", 3, sizes);
        put(&mut state, "transients.hidden", 1, hidden);
        put(&mut state, "near", 1, vec![self.raster.near]);
        put(&mut state, "step", 1, vec![self.step as u64]);
        if self.since < self.step {
            put(&mut state, "since", 1, vec![self.since as u64]);
        }
        state
    }

    /// Goes on from a state.
    ///
    /// # Errors
    /// When tensors are missing, or of another number of photos or of other settings; the fit is then as before.
    pub fn restore(&mut self, state: &Tensors) -> Result<()> {
        let n = state.get("logits.values")?.shape.first().copied().unwrap_or(0);
        let invalid = |key: &str, expected: String, found: String| {
            Err(Error::Invalid { path: state.origin().into(), place: format!("tensor {key}"), expected, found })
        };
        if n == 0 || n > self.settings.gaussians {
            return invalid("logits.values", format!("1 to {} rows", self.settings.gaussians), n.to_string());
        }
        let sh = state.get("sh.values")?.shape.get(1).copied().unwrap_or(0);
        let Some(degree) = (0..=MAX_DEGREE).find(|degree| 3 * coefficients(*degree) == sh) else {
            return invalid("sh.values", "rows of 3 (degree + 1)^2".into(), sh.to_string());
        };
        let field = |name: &str, width: usize| -> Result<Field> {
            let part = |part: &str| Ok(state.values::<f32>(&format!("{name}.{part}"), &[n, width])?.to_vec());
            let mut field = Field::new(part("values")?, width);
            (field.first, field.second) = (part("first")?, part("second")?);
            Ok(field)
        };
        let fields =
            [field("means", 3)?, field("log_scales", 3)?, field("quats", 4)?, field("logits", 1)?, field("sh", sh)?];
        let statistics = state.values::<f32>("statistics", &[n, STATISTICS])?;
        let exposures = state.values::<f32>("exposures", &[self.exposures.len(), EXPOSURE])?;
        let poses = state.values::<f64>("poses", &[self.poses.len(), POSE])?;
        let near = state.values::<f64>("near", &[1, 1])?;
        let transients = transients_of(state, self.photos.len())?;
        let step = state.values::<u64>("step", &[1, 1])?[0] as usize;
        let since = state.values::<u64>("since", &[1, 1]).map_or(step, |since| since[0] as usize);
        self.raster.near = near[0];
        (self.step, self.since) = (step, since);
        self.population = Population::from_fields(fields, degree);
        self.statistics = statistics.chunks_exact(STATISTICS).map(statistics_of).collect();
        self.exposures = exposures.chunks_exact(EXPOSURE).map(exposure_of).collect();
        self.transients = transients;
        self.poses = poses.chunks_exact(POSE).map(pose_of).collect();
        self.changed();
        Ok(())
    }
}

/// The Gaussians of the [state](Fit::state) of a fit, as a checkpoint has it.
///
/// # Errors
/// When tensors are missing or of other sizes.
pub fn gaussians_of(state: &Tensors) -> Result<Gaussians> {
    let n = state.get("logits.values")?.shape.first().copied().unwrap_or(0);
    let sh = state.get("sh.values")?.shape.get(1).copied().unwrap_or(0);
    let Some(degree) = (0..=MAX_DEGREE).find(|degree| 3 * coefficients(*degree) == sh) else {
        let path = state.origin().into();
        let place = "tensor sh.values".into();
        return Err(Error::Invalid { path, place, expected: "rows of 3 (degree + 1)^2".into(), found: sh.to_string() });
    };
    let values = |name: &str, width: usize| state.values::<f32>(&format!("{name}.values"), &[n, width]);
    Ok(Gaussians {
        means: values("means", 3)?.as_chunks().0.to_vec(),
        log_scales: values("log_scales", 3)?.as_chunks().0.to_vec(),
        quats: values("quats", 4)?.as_chunks().0.to_vec(),
        opacity_logits: values("logits", 1)?.to_vec(),
        sh: values("sh", sh)?.to_vec(),
        degree,
    })
}

/// Parts of each photo that no other shows; nothing in states that are older than these.
fn transients_of(state: &Tensors, photos: usize) -> Result<Vec<Option<Transients>>> {
    let mut transients = vec![None; photos];
    let Some(rows) = state.get("transients.sizes").ok().and_then(|sizes| sizes.shape.first().copied()) else {
        return Ok(transients);
    };
    let sizes = state.values::<u64>("transients.sizes", &[rows, 3])?;
    let cells = |row: &[u64]| row[1].saturating_mul(row[2]) as usize;
    let words = |row: &[u64]| cells(row).div_ceil(WORD);
    let all = sizes.chunks_exact(3).map(words).fold(0, usize::saturating_add);
    let mut hidden = state.values::<u64>("transients.hidden", &[all, 1])?;
    for row in sizes.chunks_exact(3) {
        let own;
        (own, hidden) = hidden.split_at(words(row));
        if let Some(photo) = transients.get_mut(row[0] as usize) {
            let size = [row[1] as usize, row[2] as usize];
            let hidden = (0..cells(row)).map(|i| own[i / WORD] >> (i % WORD) & 1 == 1).collect();
            *photo = Some(Transients { size, hidden });
        }
    }
    Ok(transients)
}

fn statistics_row(s: &GaussianStatistics<f32>) -> [f32; STATISTICS] {
    [s.screen_gradient, s.absgrad, s.views as f32, s.radius, s.contribution, s.largest_weight]
}

fn statistics_of(row: &[f32]) -> GaussianStatistics<f32> {
    GaussianStatistics {
        screen_gradient: row[0],
        absgrad: row[1],
        views: row[2] as u32,
        radius: row[3],
        contribution: row[4],
        largest_weight: row[5],
    }
}

fn exposure_row(e: &Exposure) -> Vec<f32> {
    e.matrix.iter().chain(&e.first).chain(&e.second).copied().chain([e.steps as f32]).collect()
}

fn exposure_of(row: &[f32]) -> Exposure {
    let part = |from: usize| std::array::from_fn(|i| row[from + i]);
    Exposure { matrix: part(0), first: part(12), second: part(24), steps: row[36] as u64 }
}

fn pose_row(pose: &Pose) -> Vec<f64> {
    let mut row = pose.rotation.to_cols_array().to_vec();
    row.extend(pose.translation.to_array());
    row
}

fn pose_of(row: &[f64]) -> Pose {
    let rotation = DMat3::from_cols_array(&std::array::from_fn(|i| row[i]));
    Pose::new(rotation, DVec3::new(row[9], row[10], row[11]))
}
