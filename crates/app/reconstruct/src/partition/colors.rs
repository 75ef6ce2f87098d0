//! Colors of fits of blocks brought together.

use std::collections::BTreeMap;
use weaver_geometry::glam::{DMat3, DVec3};

/// An affine map of colors `[A | b]`, `[3, 4]` row by row.
pub type ColorMap = [f32; 12];

/// Rounds in which maps of blocks and corrections of photos are found from one another.
const ROUNDS: usize = 30;
/// Maps of a smaller determinant are not inverted: they lose a color.
const LEAST_DETERMINANT: f64 = 1e-3;

/// For each block the map from its colors to the common colors of all blocks; `None` for a block that shares no photo
/// with the others, or whose corrections lose a color.
///
/// A fit corrects the colors of its photos, `photo = E(scene)`, and keeps the colors of its average photo, so that
/// blocks with other photos have other colors. A photo in two blocks gives their difference: with `E_bp` the correction
/// of photo p in block b, maps `T_b` and corrections `E_p` are sought for which `E_bp T_b = E_p`, by alternating least
/// squares from the block with the most photos outward. The mean of all `E_p` is the identity, as in one fit of the
/// whole. The result is the inverse of `T_b`.
///
/// ```
/// use std::collections::BTreeMap;
/// use weaver_reconstruct::partition::color_maps;
/// let gain = |g: f32| [g, 0.0, 0.0, 0.0, 0.0, g, 0.0, 0.0, 0.0, 0.0, g, 0.0];
/// // Both have a photo "b"; the second block is twice as bright, so that its corrections are half as large.
/// let blocks = [[("a", gain(0.8)), ("b", gain(1.0))], [("b", gain(0.5)), ("c", gain(0.6))]];
/// let maps = color_maps(&blocks.map(|block| BTreeMap::from(block.map(|(name, map)| (name.to_string(), map)))));
/// let [first, second] = [maps[0].unwrap()[0], maps[1].unwrap()[0]];
/// assert!((second / first - 0.5).abs() < 1e-5);
/// ```
pub fn color_maps(corrections: &[BTreeMap<String, ColorMap>]) -> Vec<Option<ColorMap>> {
    let blocks: Vec<BTreeMap<&str, Affine>> = (corrections.iter())
        .map(|block| block.iter().map(|(name, map)| (name.as_str(), Affine::of(map))).collect())
        .collect();
    let mut maps = joined(&blocks);
    for _ in 0..ROUNDS {
        let photos = means(&blocks, &maps);
        for (map, block) in maps.iter_mut().zip(&blocks).filter(|(map, _)| map.is_some()) {
            *map = fitted(block, &photos).or(*map);
        }
    }
    let photos = means(&blocks, &maps);
    let average = Affine::mean(photos.values());
    let inverse = |map: &Affine| Some(average?.after(&map.inverse()?).to_row());
    maps.iter().map(|map| map.as_ref().and_then(inverse)).collect()
}

/// Maps of the blocks that can be reached from the one with the most photos over photos that blocks share: first
/// guesses.
fn joined(blocks: &[BTreeMap<&str, Affine>]) -> Vec<Option<Affine>> {
    let mut maps = vec![None; blocks.len()];
    let Some(first) = (0..blocks.len()).max_by_key(|b| (blocks[*b].len(), std::cmp::Reverse(*b))) else { return maps };
    maps[first] = Some(Affine::IDENTITY);
    loop {
        let photos = means(blocks, &maps);
        let shared = |b: usize| blocks[b].keys().filter(|name| photos.contains_key(*name)).count();
        let next = (0..blocks.len()).filter(|b| maps[*b].is_none()).max_by_key(|b| (shared(*b), std::cmp::Reverse(*b)));
        let Some(found) = next.and_then(|b| Some((b, fitted(&blocks[b], &photos)?))) else { break };
        maps[found.0] = Some(found.1);
    }
    // Alone, the first has nothing to agree with.
    if maps.iter().flatten().count() < 2 { vec![None; blocks.len()] } else { maps }
}

/// The corrections of photos, each the mean over the blocks that have a map.
fn means<'n>(blocks: &[BTreeMap<&'n str, Affine>], maps: &[Option<Affine>]) -> BTreeMap<&'n str, Affine> {
    let mut all: BTreeMap<&str, Vec<Affine>> = BTreeMap::new();
    for (block, map) in blocks.iter().zip(maps).filter_map(|(block, map)| Some((block, map.as_ref()?))) {
        block.iter().for_each(|(name, own)| all.entry(name).or_default().push(own.after(map)));
    }
    all.into_iter().filter_map(|(name, found)| Some((name, Affine::mean(&found)?))).collect()
}

/// The map T with the least sum of `|E_bp T - E_p|^2` over the photos that the block shares; `None` if there are none,
/// or colors are lost.
fn fitted(block: &BTreeMap<&str, Affine>, photos: &BTreeMap<&str, Affine>) -> Option<Affine> {
    let (mut square, mut linear, mut offset) = (DMat3::ZERO, DMat3::ZERO, DVec3::ZERO);
    for (own, common) in block.iter().filter_map(|(name, own)| Some((own, photos.get(name)?))) {
        let transposed = own.linear.transpose();
        square += transposed * own.linear;
        linear += transposed * common.linear;
        offset += transposed * (common.offset - own.offset);
    }
    let inverse = inverted(&square)?;
    Some(Affine { linear: inverse * linear, offset: inverse * offset }).filter(|map| inverted(&map.linear).is_some())
}

fn inverted(matrix: &DMat3) -> Option<DMat3> {
    (matrix.determinant().abs() >= LEAST_DETERMINANT).then(|| matrix.inverse())
}

/// The map `x -> A x + b`.
#[derive(Clone, Copy, Debug)]
struct Affine {
    linear: DMat3,
    offset: DVec3,
}

impl Affine {
    const IDENTITY: Self = Self { linear: DMat3::IDENTITY, offset: DVec3::ZERO };

    fn of(map: &ColorMap) -> Self {
        let column = |i: usize| DVec3::new(map[i].into(), map[4 + i].into(), map[8 + i].into());
        Self { linear: DMat3::from_cols(column(0), column(1), column(2)), offset: column(3) }
    }

    fn to_row(self) -> ColorMap {
        std::array::from_fn(|i| if i % 4 == 3 { self.offset[i / 4] } else { self.linear.col(i % 4)[i / 4] } as f32)
    }

    /// The map that applies another one first.
    fn after(&self, first: &Self) -> Self {
        Self { linear: self.linear * first.linear, offset: self.linear * first.offset + self.offset }
    }

    fn inverse(&self) -> Option<Self> {
        let linear = inverted(&self.linear)?;
        Some(Self { linear, offset: -(linear * self.offset) })
    }

    fn mean<'m>(maps: impl IntoIterator<Item = &'m Self>) -> Option<Self> {
        let (mut sum, mut count) = (Self { linear: DMat3::ZERO, offset: DVec3::ZERO }, 0.0);
        for map in maps {
            (sum.linear, sum.offset, count) = (sum.linear + map.linear, sum.offset + map.offset, count + 1.0);
        }
        (count > 0.0).then(|| Self { linear: sum.linear * (1.0 / count), offset: sum.offset / count })
    }
}
