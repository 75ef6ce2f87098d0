//! A capture cut into blocks.

use super::BlockFile;
use crate::partition::{Block, BlockError, BlockOptions, Region, Sight, Sights, blocks};
use crate::{Error, Plan};
use std::path::{Path, PathBuf};
use weaver_data::capture::{HoldOut, Survey, SurveyedPhoto, survey};
use weaver_fit::FitSettings;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::{Camera, Undistortion};
use weaver_io::colmap::{Model, Point};
use weaver_io::{Checksum, OutputFolder, ShellCommand, Transforms, relative_path, write_text};
use weaver_scene::Frame;

/// The most blocks that are tried for a bound on memory.
const MOST: usize = 1000;
/// Part of all photos above which a block of its own saves little: the blocks of a fox, seen from all around, have 0.8
/// to 1 of them, blocks along a street a third.
const NEARLY_ALL: f64 = 0.75;

/// Options of a cut.
#[derive(Clone, Debug, PartialEq)]
pub struct SplitOptions {
    /// The capture: a folder, or a transforms.json.
    pub capture: PathBuf,
    /// Number of blocks.
    pub count: BlockCount,
    /// Share of a photo's visible points inside a block from which on the photo belongs to it
    /// ([`BlockOptions::share`]).
    pub share: f64,
    /// Gaussians of the whole scene; `None` gives each block the default number of a fit.
    pub gaussians: Option<usize>,
    /// Longest side of the photos as they will be fitted, pixels.
    pub long_side: Option<usize>,
    /// The choice of held-out photos.
    pub hold_out: HoldOut,
    /// True if photos have masks.
    pub masks: bool,
}

/// Number of blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockCount {
    /// This number.
    Exactly(usize),
    /// The fewest whose fits take at most this many bytes each.
    Memory(u64),
}

/// A capture that was cut.
#[derive(Clone, Debug, PartialEq)]
pub struct Split {
    /// The blocks, in the order of their numbers.
    pub blocks: Vec<BlockFile>,
    /// Mean color of the points, from 0 to 1: one background for the fits of all blocks.
    pub background: [f32; 3],
    /// Remarks for the user about how the capture was read.
    pub remarks: Vec<String>,
}

impl Split {
    /// The command that fits a block in the folder of the blocks.
    pub fn fit_command(&self, block: &BlockFile, blocks: &Path, options: &SplitOptions) -> ShellCommand {
        let folder = blocks.join(block.folder());
        let [r, g, b] = self.background;
        let fit = ShellCommand::new("splatweaver fit").path(folder.join(BlockFile::CAPTURE));
        let fit = fit.then("-o").path(folder.join(BlockFile::FIT));
        let fit = fit.then("--gaussians").word(block.gaussians.to_string());
        let fit = fit.then("--background").word(format!("{r:.3},{g:.3},{b:.3}"));
        let fit = match options.long_side {
            Some(side) => fit.then("--long-side").word(side.to_string()),
            None => fit,
        };
        if options.masks { fit.then("--masks") } else { fit }
    }
}

/// Cuts a capture into blocks, each a capture in a folder of its own ([`blocks`](crate::blocks)).
///
/// # Errors
/// When the capture cannot be read, has no points or too few, or a block would have no photo; when no number of blocks
/// is small enough for the memory; and when a file cannot be written.
pub fn split(options: &SplitOptions, out: &OutputFolder) -> Result<Split, Error> {
    let survey = survey(&options.capture, options.hold_out, options.masks)?;
    if survey.points.is_empty() {
        return Err(Error::Photos {
            capture: options.capture.clone(),
            key: "points",
            expected: "points that tell which photo sees what; `splatweaver cameras` finds them".into(),
            found: "none".into(),
        });
    }
    let cut = |count: usize| cut(&survey, options, count).map_err(|source| refused(options, source));
    let found = match options.count {
        BlockCount::Exactly(count) => cut(count)?,
        BlockCount::Memory(bytes) => {
            let mut least = u64::MAX;
            let fitting = (1..=MOST).map(cut).map_while(Result::ok).find(|blocks| {
                let largest = blocks.iter().map(|(_, file)| file.memory).max().unwrap_or(0);
                least = least.min(largest);
                largest <= bytes
            });
            let megabytes = |bytes: u64| bytes as f64 / 1e6;
            fitting.ok_or_else(|| Error::Photos {
                capture: options.capture.clone(),
                key: "memory",
                expected: format!("at least the {:.0} MB of the smallest blocks that there are", megabytes(least)),
                found: format!("{:.0} MB", megabytes(bytes)),
            })?
        }
    };
    for (block, file) in &found {
        write(&survey, block, file, out)?;
    }
    let colors = &survey.points.colors;
    let sum = |i: usize| colors.iter().map(|color| f64::from(color[i])).sum::<f64>();
    let background = [0, 1, 2].map(|i| (sum(i) / (255.0 * colors.len() as f64)) as f32);
    let blocks: Vec<BlockFile> = found.into_iter().map(|(_, file)| file).collect();
    let mut remarks = survey.remarks;
    let all = survey.photos.iter().filter(|photo| !photo.held_out).count();
    let most = blocks.iter().map(|block| block.photos).max().unwrap_or(0);
    if blocks.len() > 1 && most as f64 > NEARLY_ALL * all as f64 {
        remarks.push(format!(
            "a block has {most} of the {all} photos that are fitted: where nearly all photos see the same place, cutting saves little \
             memory, and one fit of the whole is better"
        ));
    }
    Ok(Split { blocks, background, remarks })
}

fn refused(options: &SplitOptions, source: BlockError) -> Error {
    Error::Blocks { capture: options.capture.clone(), source }
}

/// The blocks with the content of their files.
fn cut(survey: &Survey, options: &SplitOptions, count: usize) -> Result<Vec<(Block, BlockFile)>, BlockError> {
    let photos: Vec<Sight> = survey.photos.iter().map(sight).collect();
    let sights = Sights { points: &survey.points.positions, photos: &photos };
    let found = blocks(&sights, &BlockOptions { count, share: options.share })?;
    let split = checksum(found.iter().map(|block| &block.region));
    let file = |(number, block): (usize, &Block)| {
        let camera = |i: &usize| {
            let SurveyedPhoto { camera, held_out, .. } = &survey.photos[*i];
            (options.long_side.map_or(*camera, |side| camera.shrunk(side)), *held_out)
        };
        let cameras: Vec<(Camera, bool)> = block.photos.iter().map(camera).collect();
        let usual = Plan::of(&cameras, options.masks, &FitSettings::default()).usual();
        // As dense as one fit of the whole would be.
        let part = block.points.len() as f64 / survey.points.len() as f64;
        let gaussians = options.gaussians.map_or(usual.gaussians, |all| (all as f64 * part).ceil() as usize);
        let plan = Plan::of(&cameras, options.masks, &FitSettings { gaussians, ..usual });
        let plan = if plan.asks_for_depth() { plan.with_dense_start(&cameras) } else { plan };
        BlockFile {
            split: split.clone(),
            number,
            blocks: count,
            photos: plan.training,
            held_out: plan.held_out,
            points: block.points.len(),
            own_points: block.own,
            gaussians,
            memory: plan.total(),
            region: block.region.clone(),
        }
    };
    let files: Vec<BlockFile> = found.iter().enumerate().map(file).collect();
    Ok(found.into_iter().zip(files).collect())
}

fn sight(photo: &SurveyedPhoto) -> Sight<'_> {
    let SurveyedPhoto { camera, held_out, visible, .. } = photo;
    Sight { pose: camera.pose, held_out: *held_out, visible }
}

/// Checksum of the planes of all regions.
fn checksum<'a>(regions: impl Iterator<Item = &'a Region>) -> String {
    let mut sum = Checksum::default();
    for cut in regions.flat_map(|region| &region.cuts) {
        cut.normal.iter().chain([&cut.offset]).for_each(|x| sum.word(x.to_bits()));
        sum.word(u64::from(cut.above));
    }
    sum.to_string()
}

/// Writes a block as a capture whose photos stay where they are.
fn write(survey: &Survey, block: &Block, file: &BlockFile, out: &OutputFolder) -> Result<(), Error> {
    let folder = file.folder();
    let capture = format!("{folder}/{}", BlockFile::CAPTURE);
    let photos: Vec<&SurveyedPhoto> = block.photos.iter().map(|i| &survey.photos[*i]).collect();
    let place = out.path().join(&capture);
    let frame = |photo: &&SurveyedPhoto| {
        let Frame { path, camera, distortion, mask, time, number, .. } = &photo.frame;
        let mask = mask.as_ref().map(|mask| relative_path(&place, mask)).transpose()?.map(PathBuf::from);
        let named = Frame::new(relative_path(&place, path)?, *camera);
        Ok(Frame { distortion: *distortion, mask, time: *time, number: *number, ..named })
    };
    let frames = photos.iter().map(frame).collect::<Result<Vec<_>, weaver_io::Error>>()?;
    let held_out = photos.iter().zip(&frames).filter(|(photo, _)| photo.held_out);
    let test_filenames = Some(held_out.map(|(_, frame)| frame.name.clone()).collect());
    model(survey, block, &frames).write_binary(out.files(&format!("{capture}/sparse/0"), Model::FILES)?)?;
    Transforms { frames, test_filenames, origin: survey.origin, ..Transforms::default() }
        .write(out.file(format!("{capture}/transforms.json"))?)?;
    let text = serde_json::to_string_pretty(file).expect("numbers and names") + "\n";
    Ok(write_text(out.file(format!("{folder}/{}", BlockFile::NAME))?, &text)?)
}

/// The model of COLMAP of a block, with its points and their tracks.
fn model(survey: &Survey, block: &Block, frames: &[Frame]) -> Model {
    let mut model = Model::from_frames(frames);
    let mut place = vec![None; survey.points.len()];
    for (at, &i) in block.points.iter().enumerate() {
        place[i] = Some(at);
        let xyz = survey.points.positions[i].map(f64::from);
        let id = at as u64 + 1;
        model.points.push(Point { id, xyz, rgb: survey.points.colors[i], error: 0.0, track: Vec::new() });
    }
    for (image, &i) in model.images.iter_mut().zip(&block.photos) {
        let SurveyedPhoto { frame, camera, visible, .. } = &survey.photos[i];
        let lens = frame.distortion.and_then(|distortion| Undistortion::new(frame.camera, distortion));
        for at in visible.iter().filter_map(|point| place[*point as usize]) {
            let point = &mut model.points[at];
            point.track.push((image.id, image.points.len() as u32));
            let straight = camera.intrinsics.project(camera.pose.apply(DVec3::from(point.xyz)));
            let DVec2 { x, y } = lens.as_ref().map_or(straight, |lens| lens.distorted(straight));
            image.points.push((x, y, Some(point.id)));
        }
    }
    model
}
