//! Objects along a walk: houses with windows, sills, balconies and posters, and things on the pavement.

use super::paint::Paint;
use super::picture::Block;
use super::{Draws, INSIDE, OUTSIDE};
use std::f64::consts::FRAC_PI_2;
use weaver_geometry::glam::{DVec2, DVec3};

/// Height of a floor, and width of a window's section.
const FLOOR: f64 = 3.0;
const BAY: f64 = 2.4;
/// Depth of houses.
const DEEP: f64 = 4.0;

/// A street around a block of houses, for a way that far from the middle.
pub(super) fn street(half: DVec2, draws: &mut Draws) -> Vec<Block> {
    let mut blocks = vec![ground(half + OUTSIDE + DEEP, draws)];
    for turn in 0..4 {
        let along = DVec2::from_angle(FRAC_PI_2 * f64::from(turn)).round();
        let right = -along.perp();
        let [half, other] = if turn % 2 == 0 { [half.x, half.y] } else { [half.y, half.x] };
        let mut outer = Side { origin: right * (other + OUTSIDE), along, toward: -right, blocks: &mut blocks };
        outer.houses(half + OUTSIDE, draws);
        for _ in 0..(half * 0.8) as usize {
            let (at, out, size) = (draws.within(-half, half), draws.within(0.6, 2.6), draws.within(0.3, 0.9));
            outer.put([at, at + size], [out, out + size], [0.0, draws.within(0.3, 1.4)], Paint::poster(draws));
        }
        if other - INSIDE > 1.0 {
            let mut inner = Side { origin: right * (other - INSIDE), along, toward: right, blocks: &mut blocks };
            inner.houses(half - INSIDE, draws);
        }
    }
    blocks
}

/// One building along the x axis, seen from -y.
pub(super) fn facade(length: f64, draws: &mut Draws) -> Vec<Block> {
    let mut blocks = vec![ground(DVec2::new(length + 20.0, 30.0), draws)];
    let mut side = Side { origin: DVec2::ZERO, along: DVec2::X, toward: DVec2::NEG_Y, blocks: &mut blocks };
    let wall = Paint { contrast: 0.25, ..Paint::plaster(draws) };
    side.house(-2.0 * BAY, [(length / BAY) as usize + 4, 3], wall, draws);
    blocks
}

fn ground(half: DVec2, draws: &mut Draws) -> Block {
    let paint = Paint { coarsest: 2.0, ..Paint::plaster(draws) };
    Block { low: (-half).extend(-0.5), high: half.extend(0.0), paint }
}

/// A line along which things stand.
struct Side<'a> {
    origin: DVec2,
    along: DVec2,
    /// From the houses to the street.
    toward: DVec2,
    blocks: &'a mut Vec<Block>,
}

impl Side<'_> {
    /// A box between places along the side, distances from it toward the street, and heights.
    fn put(&mut self, along: [f64; 2], out: [f64; 2], up: [f64; 2], paint: Paint) {
        let end = |i: usize| -> DVec3 { (self.origin + self.along * along[i] + self.toward * out[i]).extend(up[i]) };
        let [a, b] = [end(0), end(1)];
        self.blocks.push(Block { low: a.min(b), high: a.max(b), paint });
    }

    /// Houses from one end to the other, some a little behind the line.
    fn houses(&mut self, half: f64, draws: &mut Draws) {
        let (line, mut at) = (self.origin, -half);
        while at < half - BAY {
            let bays = (3 + draws.below(4)).min(((half - at) / BAY) as usize);
            self.origin = line - self.toward * draws.within(0.0, 0.8);
            let wall = Paint::plaster(draws);
            let floors = 2 + draws.below(3);
            self.house(at, [bays, floors], wall, draws);
            at += bays as f64 * BAY;
        }
        self.origin = line;
    }

    /// A house with windows that are all the same, and a ground floor that is like no other.
    fn house(&mut self, from: f64, [bays, floors]: [usize; 2], wall: Paint, draws: &mut Draws) {
        let (to, top) = (from + bays as f64 * BAY, floors as f64 * FLOOR + 0.5);
        self.put([from, to], [-DEEP, 0.0], [0.0, top], wall);
        self.put([from, to], [0.0, 0.45], [top - 0.35, top], Paint::trim(draws));
        self.put([from, from + 0.3], [0.0, 0.25], [0.0, top - 0.35], Paint::trim(draws));
        let [frame, sill, rail] = [(); 3].map(|()| Paint::trim(draws));
        let glass = Paint::pane(draws);
        let balconies = draws.chance(0.5);
        for (bay, floor) in (0..bays).flat_map(|bay| (0..floors).map(move |floor| (bay, floor))) {
            let middle = from + (bay as f64 + 0.55) * BAY;
            let base = floor as f64 * FLOOR;
            let mut part = |wide: f64, out: [f64; 2], up: [f64; 2], paint: Paint| {
                self.put([middle - wide / 2.0, middle + wide / 2.0], out, up.map(|up| base + up), paint);
            };
            if floor == 0 {
                let paint = Paint::poster(draws);
                match draws.below(3) {
                    0 => part(1.1, [0.0, 0.1], [0.0, 2.2], paint),
                    1 => part(draws.within(0.7, 1.6), [0.0, 0.03], [0.9, draws.within(1.8, 2.5)], paint),
                    _ => part(1.5, [0.0, draws.within(0.2, 0.6)], [0.6, draws.within(1.0, 1.9)], paint),
                }
                continue;
            }
            part(1.2, [0.0, 0.12], [0.8, 2.4], frame);
            part(1.0, [0.12, 0.13], [0.9, 2.3], glass);
            part(1.4, [0.0, 0.3], [0.7, 0.8], sill);
            if balconies && bay % 2 == 1 {
                part(1.8, [0.0, 0.8], [0.0, 0.15], sill);
                part(1.8, [0.72, 0.8], [0.15, 0.75], rail);
            }
        }
    }
}
