//! Streamed SOG: a scene in levels of detail, in parts that a viewer loads as it needs them.
//!
//! `lod-meta.json` has a binary tree of boxes. A leaf says for each level where its Gaussians are: a file, and a range
//! of the Gaussians in it. Files are SOG scenes in folders of their own, `LEVEL_NUMBER/meta.json`. Level 0 has all
//! Gaussians, each further one a quarter of those before, merged: from twice the distance, where a pixel shows four
//! times the area, it has as many Gaussians for each pixel.
//!
//! Source: developer.playcanvas.com/user-manual/gaussian-splatting/formats/streamed-sog.

use super::META;
use super::decode::decoded;
use super::encode::{File, files};
use super::meta::Meta;
use crate::gaussians::fields::check_values;
use crate::gaussians::order::nearby;
use crate::gaussians::scene_file::{Drawing, SceneFile};
use crate::{Error, Result};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Component, Path};
use weaver_scene::Gaussians;

/// The file that names the others.
pub(crate) const LOD_META: &str = "lod-meta.json";
/// The version that is read and written.
const VERSION: u64 = 1;
/// Gaussians of a level over those of the next.
const RATIO: usize = 4;
/// A level of so few Gaussians is the last.
const FEW: usize = 20_000;
/// Most Gaussians of the finest level in a leaf.
const LEAF: usize = 1 << 15;
/// A file with so many Gaussians gets no more.
const FILE: usize = 1 << 17;
/// Most levels that are read.
const MOST_LEVELS: usize = 64;

#[derive(Debug, Deserialize, Serialize)]
struct Document {
    #[serde(default)]
    version: Option<u64>,
    #[serde(default)]
    count: usize,
    #[serde(default)]
    counts: Vec<usize>,
    #[serde(rename = "lodLevels")]
    levels: usize,
    /// A scene around the others, such as a sky, in all levels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    environment: Option<String>,
    filenames: Vec<String>,
    tree: Node,
}

/// A box, and what is in it.
#[derive(Debug, Deserialize, Serialize)]
struct Node {
    bound: Bound,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    children: Vec<Node>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    lods: BTreeMap<usize, Span>,
}

/// Two corners, in world units.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
struct Bound {
    min: [f32; 3],
    max: [f32; 3],
}

/// Gaussians of a file.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
struct Span {
    file: usize,
    offset: usize,
    count: usize,
}

/// Something that reads a file of the scene by its name, with slashes.
type Files<'a> = &'a mut dyn FnMut(&str) -> Result<Vec<u8>>;

/// The finest level of a scene.
pub(super) fn decoded_finest(path: &Path, data: &[u8], files: Files) -> Result<SceneFile> {
    let document = Document::read(path, data)?;
    let mut spans = Vec::new();
    document.tree.finest(&mut spans);
    let mut scenes: BTreeMap<usize, SceneFile> = BTreeMap::new();
    let mut taken: BTreeMap<usize, usize> = BTreeMap::new();
    let mut parts = Vec::new();
    for Span { file, offset, count } in spans {
        let name = document.file(path, file)?;
        let scene = match scenes.entry(file) {
            std::collections::btree_map::Entry::Occupied(scene) => scene.into_mut(),
            std::collections::btree_map::Entry::Vacant(place) => place.insert(part(path, name, files)?),
        };
        let rows = offset.checked_add(count).filter(|end| *end <= scene.gaussians.len()).map(|end| offset..end);
        let rows = rows.ok_or_else(|| {
            let expected = format!("a range of the {} Gaussians of {name}", scene.gaussians.len());
            Error::invalid(path, format!("{LOD_META}, tree"), expected, format!("{count} from {offset}"))
        })?;
        // A small tree must not ask for the same Gaussians again and again.
        let taken = taken.entry(file).or_default();
        *taken += count;
        if *taken > scene.gaussians.len() {
            let expected = format!("each Gaussian of {name} in one leaf");
            return Err(Error::invalid(path, format!("{LOD_META}, tree"), expected, "some in several"));
        }
        parts.push(scene.gaussians.slice(rows));
    }
    if let Some(name) = &document.environment {
        parts.push(part(path, name, files)?.gaussians);
    }
    let drawing = scenes.values().next().map_or(Drawing::default(), |scene| scene.drawing);
    Ok(SceneFile { gaussians: Gaussians::joined(&parts), drawing })
}

/// The scene of a file that a document names.
fn part(path: &Path, name: &str, files: Files) -> Result<SceneFile> {
    let meta = files(name)?;
    decoded(&path.with_file_name(name), &meta, &mut |picture| files(&beside(name, picture)))
}

/// The name of a file in the folder of another.
fn beside(name: &str, other: &str) -> String {
    name.rsplit_once('/').map_or_else(|| other.to_string(), |(folder, _)| format!("{folder}/{other}"))
}

/// Names of the files of a scene, this one among them.
pub(super) fn names(path: &Path, data: &[u8], files: Files) -> Result<Vec<String>> {
    let document = Document::read(path, data)?;
    let mut names = Vec::new();
    for name in document.filenames.iter().chain(&document.environment) {
        let meta = Meta::read(&path.with_file_name(name), &files(name)?)?;
        names.extend(meta.files().chain([META.to_string()]).map(|other| beside(name, &other)));
    }
    names.push(LOD_META.into());
    Ok(names)
}

/// True if a name stays within the folder of the scene.
pub(super) fn is_inside(name: &str) -> bool {
    !name.is_empty() && Path::new(name).components().all(|part| matches!(part, Component::Normal(_)))
}

impl Document {
    fn read(path: &Path, data: &[u8]) -> Result<Self> {
        let wrong = |e: serde_json::Error| Error::invalid(path, LOD_META, "the keys of streamed SOG", e);
        let document: Self = serde_json::from_slice(data).map_err(wrong)?;
        let invalid = |key: &str, expected: &str, found: String| {
            Err(Error::invalid(path, format!("{LOD_META}, {key}"), expected, found))
        };
        match document {
            Self { version: Some(version), .. } if version != VERSION => {
                invalid("version", &VERSION.to_string(), version.to_string())
            }
            Self { levels, .. } if !(1..=MOST_LEVELS).contains(&levels) => {
                invalid("lodLevels", &format!("from 1 to {MOST_LEVELS}"), levels.to_string())
            }
            _ => {
                let leads_out = document.filenames.iter().chain(&document.environment).find(|name| !is_inside(name));
                match leads_out.cloned() {
                    Some(name) => invalid("filenames", "names of files in this folder", format!("{name:?}")),
                    None => Ok(document),
                }
            }
        }
    }

    fn file(&self, path: &Path, file: usize) -> Result<&str> {
        let expected = || format!("a number below {}", self.filenames.len());
        let place = || format!("{LOD_META}, tree, file");
        self.filenames.get(file).map(String::as_str).ok_or_else(|| Error::invalid(path, place(), expected(), file))
    }
}

impl Node {
    /// The finest spans of all leaves, in their order.
    fn finest(&self, spans: &mut Vec<Span>) {
        spans.extend(self.lods.values().next());
        self.children.iter().for_each(|child| child.finest(spans));
    }
}

/// The numbers of Gaussians in the order in which the finest level has them.
pub(super) fn order(gaussians: &Gaussians) -> Vec<usize> {
    Levels::of(vec![gaussians.clone()]).order.swap_remove(0)
}

/// The files of a scene, `lod-meta.json` last.
pub(super) fn encoded(path: &Path, gaussians: &Gaussians, drawing: Drawing) -> Result<Vec<File>> {
    check_values(path, gaussians)?;
    let mut levels = vec![gaussians.clone()];
    while let Some(last) = levels.last().filter(|last| last.len() > FEW) {
        levels.push(last.merged(last.len() / RATIO));
    }
    let Levels { scenes, order, files: starts, tree } = Levels::of(levels);
    let parts: Vec<(usize, usize)> =
        starts.iter().enumerate().flat_map(|(level, starts)| (0..starts.len()).map(move |i| (level, i))).collect();
    let encode = |&(level, i): &(usize, usize)| -> Result<Vec<File>> {
        let end = starts[level].get(i + 1).copied().unwrap_or(order[level].len());
        let scene = scenes[level].select(&order[level][starts[level][i]..end]);
        let files = files(&scene, drawing).map_err(Error::io(path))?;
        Ok(files.into_iter().map(|file| File { name: format!("{level}_{i}/{}", file.name), ..file }).collect())
    };
    let mut files: Vec<File> =
        parts.par_iter().map(encode).collect::<Result<Vec<_>>>()?.into_iter().flatten().collect();
    let document = Document {
        version: Some(VERSION),
        count: scenes.iter().map(Gaussians::len).sum(),
        counts: scenes.iter().map(Gaussians::len).collect(),
        levels: scenes.len(),
        environment: None,
        filenames: parts.iter().map(|(level, i)| format!("{level}_{i}/{META}")).collect(),
        tree,
    };
    let content = serde_json::to_vec(&document).map_err(|e| Error::io(path)(e.into()))?;
    files.push(File { name: LOD_META.into(), content });
    Ok(files)
}

/// Levels of detail, divided into boxes.
struct Levels {
    /// The Gaussians of each level, the finest first.
    scenes: Vec<Gaussians>,
    /// Their numbers, leaf after leaf.
    order: Vec<Vec<usize>>,
    /// The first Gaussian of each file of a level, in that order.
    files: Vec<Vec<usize>>,
    tree: Node,
}

impl Levels {
    fn of(scenes: Vec<Gaussians>) -> Self {
        let empty = Node { bound: Bound { min: [0.0; 3], max: [0.0; 3] }, children: Vec::new(), lods: BTreeMap::new() };
        let members = scenes.iter().map(|scene| (0..scene.len()).collect()).collect();
        let (order, files) = (vec![Vec::new(); scenes.len()], vec![vec![0]; scenes.len()]);
        let mut levels = Self { scenes, order, files, tree: empty };
        levels.tree = levels.node(members);
        levels.number_files();
        levels
    }

    /// The box of these members of each level: a leaf, or divided at the median of the finest level's centers.
    fn node(&mut self, members: Vec<Vec<usize>>) -> Node {
        if let Some((axis, at)) = self.cut(&members[0]) {
            let (mut below, mut above) = (Vec::new(), Vec::new());
            for (scene, members) in self.scenes.iter().zip(members) {
                let (left, right) = members.into_iter().partition(|&i| scene.means[i][axis] < at);
                below.push(left);
                above.push(right);
            }
            let children = vec![self.node(below), self.node(above)];
            let (a, b) = (children[0].bound, children[1].bound);
            let join =
                |a: [f32; 3], b: [f32; 3], choose: fn(f32, f32) -> f32| std::array::from_fn(|i| choose(a[i], b[i]));
            let bound = Bound { min: join(a.min, b.min, f32::min), max: join(a.max, b.max, f32::max) };
            return Node { bound, children, lods: BTreeMap::new() };
        }
        let bound = self.bound(&members);
        let mut lods = BTreeMap::new();
        for (level, members) in members.into_iter().enumerate().filter(|(_, members)| !members.is_empty()) {
            let (order, starts) = (&mut self.order[level], &mut self.files[level]);
            if order.len() - starts.last().expect("a first file") >= FILE {
                starts.push(order.len());
            }
            let offset = order.len() - starts.last().expect("a first file");
            lods.insert(level, Span { file: starts.len() - 1, offset, count: members.len() });
            // Neighbors among pixels are then neighbors in space.
            let means: Vec<[f32; 3]> = members.iter().map(|&i| self.scenes[level].means[i]).collect();
            order.extend(nearby(&means).into_iter().map(|at| members[at]));
        }
        Node { bound, children: Vec::new(), lods }
    }

    /// Where the finest level's members are divided, if they are too many for a leaf and not all at one place.
    fn cut(&self, members: &[usize]) -> Option<(usize, f32)> {
        if members.len() <= LEAF {
            return None;
        }
        let along = |axis: usize| members.iter().map(move |&i| self.scenes[0].means[i][axis]);
        let least = |axis| along(axis).fold(f32::INFINITY, f32::min);
        let length = |axis: usize| along(axis).fold(f32::NEG_INFINITY, f32::max) - least(axis);
        let axis = (0..3).max_by(|&a, &b| length(a).total_cmp(&length(b)))?;
        let mut values: Vec<f32> = along(axis).collect();
        let middle = values.len() / 2;
        let at = *values.select_nth_unstable_by(middle, f32::total_cmp).1;
        // Something is below the median, unless it is the least value.
        (at > least(axis)).then_some((axis, at))
    }

    /// The box of Gaussians to one standard deviation of their longest axes.
    fn bound(&self, members: &[Vec<usize>]) -> Bound {
        let mut bound = Bound { min: [f32::INFINITY; 3], max: [f32::NEG_INFINITY; 3] };
        for (scene, members) in self.scenes.iter().zip(members) {
            for &i in members {
                let reach = scene.log_scales[i].iter().copied().fold(f32::NEG_INFINITY, f32::max).exp();
                for axis in 0..3 {
                    bound.min[axis] = bound.min[axis].min(scene.means[i][axis] - reach);
                    bound.max[axis] = bound.max[axis].max(scene.means[i][axis] + reach);
                }
            }
        }
        // No members: a scene of none.
        if bound.min[0] > bound.max[0] { Bound { min: [0.0; 3], max: [0.0; 3] } } else { bound }
    }

    /// Files of a level are numbered from 0 while leaves are made; in the document, all levels' follow each other.
    fn number_files(&mut self) {
        let first: Vec<usize> =
            self.files.iter().scan(0, |next, starts| Some(std::mem::replace(next, *next + starts.len()))).collect();
        fn number(node: &mut Node, first: &[usize]) {
            node.lods.iter_mut().for_each(|(level, span)| span.file += first[*level]);
            node.children.iter_mut().for_each(|child| number(child, first));
        }
        number(&mut self.tree, &first);
    }
}
