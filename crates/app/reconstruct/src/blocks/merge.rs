//! Fits of blocks joined.

use super::BlockFile;
use crate::partition::{ColorMap, color_maps, merged};
use crate::{Error, Outcome};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use weaver_io::{Drawing, SceneFile, Transforms, read_scene, read_text};
use weaver_run::Folder;
use weaver_scene::{Gaussians, forms};

/// Fits of blocks, joined.
#[derive(Clone, Debug)]
pub struct Merged {
    /// The scene.
    pub gaussians: Gaussians,
    /// Drawing that it was fitted for.
    pub drawing: Drawing,
    /// The background color of the fits.
    pub background: [f32; 3],
    /// Gaussians of all fits, frames included.
    pub fitted: usize,
    /// Remarks for the user about fits that do not belong together.
    pub remarks: Vec<String>,
}

/// The correction of photos that are drawn as they are.
const AS_IT_IS: ColorMap = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// Joins the fits of the blocks in a folder that [`split`](super::split) wrote: of each the Gaussians in its region.
/// Where fits corrected the colors of photos, their colors are [brought together](color_maps) first.
///
/// # Errors
/// When the folder holds no blocks, or not all of one split; when a block has no complete fit; and when a file cannot
/// be read.
pub fn merge(folder: &Path) -> Result<Merged, Error> {
    let blocks = blocks_in(folder)?;
    let mut fits = Vec::with_capacity(blocks.len());
    let (mut outcomes, mut fitted, mut drawings, mut corrections) = (Vec::new(), 0, Vec::new(), Vec::new());
    for (path, block) in blocks {
        let fit = path.join(BlockFile::FIT);
        let outcome = outcome(&fit, &path)?;
        let SceneFile { gaussians, drawing } = read_scene(fit.join("scene.ply"))?;
        fitted += gaussians.len();
        fits.push((block.region, gaussians));
        drawings.push(drawing);
        corrections.push(corrections_of(&outcome, &path)?);
        outcomes.push((fit, outcome));
    }
    let [(_, first), ..] = &outcomes[..] else { return Err(missing(folder, "at least one block", "none")) };
    let mut remarks = Vec::new();
    for (fit, outcome) in &outcomes {
        let fit = fit.display();
        if (outcome.antialiased, outcome.background) != (first.antialiased, first.background) {
            remarks
                .push(format!("{fit}: fitted with another background or another --antialiased than the first block"));
        }
    }
    if outcomes.iter().any(|(_, outcome)| !outcome.exposures.is_empty()) {
        for (((fit, _), (_, gaussians)), map) in outcomes.iter().zip(&mut fits).zip(color_maps(&corrections)) {
            match map {
                Some(map) => {
                    let coefficients = gaussians.coefficients();
                    forms::map_colors(&mut gaussians.sh, coefficients, &map);
                }
                None => remarks.push(format!(
                    "{}: colors of photos were corrected, and no photo is also in another block: it may differ in color",
                    fit.display()
                )),
            }
        }
    }
    let background = first.background;
    Ok(Merged { gaussians: merged(&fits), drawing: drawings[0], background, fitted, remarks })
}

/// The folders of all blocks of a split with the content of their files, in the order of their numbers.
fn blocks_in(folder: &Path) -> Result<Vec<(PathBuf, BlockFile)>, Error> {
    let first = read(folder, 0)?;
    let numbered = |number: usize| {
        let (path, block) = read(folder, number)?;
        if (&block.split, block.number) != (&first.1.split, number) {
            return Err(missing(&path, "the block of this number, of the same split as the first", "another"));
        }
        Ok((path, block))
    };
    (0..first.1.blocks).map(numbered).collect()
}

/// The folder of a block with the content of its file.
fn read(folder: &Path, number: usize) -> Result<(PathBuf, BlockFile), Error> {
    let path = folder.join(BlockFile::folder_of(number));
    let file = path.join(BlockFile::NAME);
    if !file.is_file() {
        return Err(missing(&path, "a block that `splatweaver split` wrote", "none"));
    }
    let block = serde_json::from_str(&read_text(&file)?).map_err(|e| weaver_io::Error::Invalid {
        path: file,
        place: "block".into(),
        expected: "what `splatweaver split` writes".into(),
        found: e.to_string(),
    })?;
    Ok((path, block))
}

/// The corrections of the photos of a block, by their names; where its fit made none, all are drawn as they are.
fn corrections_of(outcome: &Outcome, block: &Path) -> Result<BTreeMap<String, ColorMap>, Error> {
    if !outcome.exposures.is_empty() {
        return Ok(outcome.exposures.clone());
    }
    let transforms = Transforms::read(block.join(BlockFile::CAPTURE).join("transforms.json"))?;
    Ok(transforms.frames.into_iter().map(|frame| (frame.name, AS_IT_IS)).collect())
}

/// The outcome of a complete fit.
fn outcome(fit: &Path, block: &Path) -> Result<Outcome, Error> {
    let summary = fit.join(Folder::SUMMARY);
    let expected = format!("a complete fit of {}", block.join(BlockFile::CAPTURE).display());
    if !summary.is_file() {
        return Err(missing(fit, &expected, "none"));
    }
    let outcome: Outcome = serde_json::from_str(&read_text(&summary)?).map_err(|e| weaver_io::Error::Invalid {
        path: summary.clone(),
        place: "summary".into(),
        expected: "that of a fit".into(),
        found: e.to_string(),
    })?;
    if outcome.steps < outcome.planned {
        return Err(missing(fit, &expected, &format!("{} of {} steps", outcome.steps, outcome.planned)));
    }
    Ok(outcome)
}

fn missing(path: &Path, expected: &str, found: &str) -> Error {
    let (expected, found) = (expected.to_string(), found.to_string());
    Error::Photos { capture: path.into(), key: "blocks", expected, found }
}
