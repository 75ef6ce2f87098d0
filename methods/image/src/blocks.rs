//! Division of the Gaussians of a file into blocks of neighbors.

use crate::gaussians::Gaussians;
use crate::record::record;
use crate::rounding::{Grid, Parts, Symbols};
use crate::symbols::sort;
use crate::window::Window;

/// Divides symbols into blocks of at most `most`, by halves of the Gaussians along the axis with the larger extent of
/// their centers; there is one block at least. Each is in the order of coding.
pub fn divide(grid: &Grid, symbols: Vec<Symbols>, most: usize) -> Vec<Vec<Symbols>> {
    let placed = symbols.into_iter().map(|symbols| (grid.center(&symbols), symbols)).collect();
    let mut blocks = Vec::new();
    halve(placed, most, &mut blocks);
    blocks.iter_mut().for_each(|block| sort(block));
    blocks
}

fn halve(mut placed: Vec<([f64; 2], Symbols)>, most: usize, blocks: &mut Vec<Vec<Symbols>>) {
    if placed.len() <= most {
        return blocks.push(placed.into_iter().map(|(_, symbols)| symbols).collect());
    }
    let apart = [0, 1].map(|axis| {
        let along = || placed.iter().map(|(center, _)| center[axis]);
        along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
    });
    let axis = usize::from(apart[1] > apart[0]);
    // Ties are broken by all symbols, so that the order of the input does not matter.
    placed.sort_by(|(a, s), (b, t)| a[axis].total_cmp(&b[axis]).then_with(|| s.cmp(t)));
    let second = placed.split_off(placed.len() / 2);
    halve(placed, most, blocks);
    halve(second, most, blocks);
}

/// The pixels within the cut of a block's Gaussians, and one more around them: first column and row, and those behind
/// the last, held within the picture.
pub fn extent(grid: &Grid, block: &[Symbols], cut: f64) -> [u32; 4] {
    let [width, height] = grid.size.map(|side| side as f64);
    let (mut low, mut high) = ([width, height], [0.0; 2]);
    let mut one = Gaussians::zeros(1);
    for symbols in block {
        grid.write(symbols, &mut one, 0, Parts { shape: true, position: true, color: false });
        let half = record(&one, 0).1;
        for axis in 0..2 {
            let (center, reach) = (f64::from(one.centers[axis]), cut * half[axis] + 1.0);
            low[axis] = (center - reach).floor().min(low[axis]);
            high[axis] = (center + reach).ceil().max(high[axis]);
        }
    }
    let held = |x: f64, side: f64| x.clamp(0.0, side) as u32;
    [held(low[0], width), held(low[1], height), held(high[0], width), held(high[1], height)]
}

/// True if a window may show Gaussians of this extent.
pub fn meets(&[x0, y0, x1, y1]: &[u32; 4], window: &Window) -> bool {
    let along = |low: u32, high: u32, first: usize, length: usize| {
        low as usize <= first.saturating_add(length) && high as usize >= first
    };
    along(x0, x1, window.x, window.width) && along(y0, y1, window.y, window.height)
}
