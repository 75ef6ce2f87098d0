//! The division of a forest into leaves with the least loss at a given count.
//!
//! For a price of a Gaussian, the cheapest division of each tree follows from its subtrees' divisions: the best of one
//! leaf with any number of Gaussians and of the sum of its children (Breiman et al., Classification and Regression
//! Trees, 1984; Chou et al., IEEE Trans. Inf. Theory 35, 1989). A search finds the price at which the count is just not
//! exceeded; the remaining Gaussians go to single trees.

use super::forest::Forest;
use crate::cell::COARSEST;

/// The mark of a node that is divided.
const DIVIDED: u8 = u8::MAX;
/// Halvings of the interval that holds the price.
const HALVINGS: usize = 40;

/// A leaf and its number of Gaussians.
pub(super) type Leaf = (usize, u8);

/// Divides a forest.
pub(super) struct Pruning<'a> {
    forest: &'a Forest,
    /// Loss of each node with 0 to `most` Gaussians `[nodes, 1 + most]`; infinite if it must not have so many.
    losses: &'a [f32],
    most: usize,
}

/// Division of each node at one price.
struct Division {
    choice: Vec<u8>,
    /// Gaussians below each node.
    count: Vec<u32>,
    total: usize,
}

impl<'a> Pruning<'a> {
    pub fn new(forest: &'a Forest, losses: &'a [f32], most: usize) -> Self {
        Self { forest, losses, most }
    }

    fn at_price(&self, price: f64) -> Division {
        let nodes = self.forest.nodes();
        let (mut choice, mut count, mut cost) = (vec![0; nodes], vec![0; nodes], vec![0.0_f64; nodes]);
        for level in 0..=COARSEST {
            for node in self.forest.level(level) {
                let leaves = (0..=self.most).map(|e| (f64::from(self.loss(node, e)) + price * e as f64, e));
                let (best, e) = leaves.reduce(|a, b| if b.0 < a.0 { b } else { a }).unwrap_or_default();
                (cost[node], choice[node], count[node]) = (best, e as u8, e as u32);
                if level > 0 {
                    let children = || self.forest.children(level, node);
                    let divided = children().map(|child| cost[child]).sum();
                    if divided < best {
                        cost[node] = divided;
                        choice[node] = DIVIDED;
                        count[node] = children().map(|child| count[child]).sum();
                    }
                }
            }
        }
        let total = self.forest.level(COARSEST).map(|root| count[root] as usize).sum();
        Division { choice, count, total }
    }

    fn loss(&self, node: usize, gaussians: usize) -> f32 {
        self.losses[node * (1 + self.most) + gaussians]
    }

    /// The leaves of the best division into at most `budget` Gaussians, and into exactly so many where leaves can take
    /// more.
    pub fn leaves(&self, budget: usize) -> Vec<Leaf> {
        let largest = self.losses.iter().filter(|d| d.is_finite()).fold(0.0_f32, |a, b| a.max(*b));
        // Above `dear` the fewest Gaussians are the best; below `cheap`, nearly the most.
        let (mut dear, mut cheap) = (f64::from(largest).max(1e-30).ln() + 12.0, -70.0_f64);
        let (mut few, mut many) = (self.at_price(dear.exp()), self.at_price(cheap.exp()));
        if many.total <= budget {
            few = self.at_price(cheap.exp());
        } else {
            for _ in 0..HALVINGS {
                let middle = 0.5 * (dear + cheap);
                let division = self.at_price(middle.exp());
                if division.total <= budget {
                    (dear, few) = (middle, division);
                } else {
                    (cheap, many) = (middle, division);
                }
                if few.total == budget {
                    break;
                }
            }
        }
        let mut left = budget.saturating_sub(few.total);
        let mut leaves = Vec::with_capacity(budget);
        for root in self.forest.level(COARSEST) {
            let more = (many.count[root] as usize).saturating_sub(few.count[root] as usize);
            let division = if more <= left && many.count[root] >= few.count[root] { &many } else { &few };
            left -= if std::ptr::eq(division, &many) { more } else { 0 };
            self.collect(COARSEST, root, division, &mut leaves);
        }
        self.spend(left, &mut leaves);
        leaves
    }

    fn collect(&self, level: u8, node: usize, division: &Division, leaves: &mut Vec<Leaf>) {
        match division.choice[node] {
            DIVIDED => {
                self.forest.children(level, node).for_each(|child| self.collect(level - 1, child, division, leaves))
            }
            e => leaves.push((node, e)),
        }
    }

    /// So many Gaussians more: one more for each of the leaves that gain most by it, and where no leaf can take more, a
    /// division.
    fn spend(&self, mut left: usize, leaves: &mut Vec<Leaf>) {
        while left > 0 {
            let room = leaves.iter().enumerate().filter(|(_, (_, e))| (1..self.most).contains(&usize::from(*e)));
            let mut gains: Vec<(f32, usize)> = room.map(|(i, leaf)| (self.gain(*leaf), i)).collect();
            gains.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            for (_, i) in gains.iter().take(left) {
                leaves[*i].1 += 1;
            }
            left = left.saturating_sub(gains.len());
            if left > 0 && gains.is_empty() && !self.divide(&mut left, leaves) {
                return;
            }
        }
    }

    /// Gain of a leaf by one Gaussian more.
    fn gain(&self, (node, e): Leaf) -> f32 {
        let (now, then) = (self.loss(node, e.into()), self.loss(node, usize::from(e) + 1));
        if then.is_finite() { now - then } else { f32::MIN }
    }

    /// Divides the full leaf that loses most, each child with one Gaussian. If these are more than are left, another
    /// leaf gives some.
    fn divide(&self, left: &mut usize, leaves: &mut Vec<Leaf>) -> bool {
        let loss = |&(node, e): &Leaf| if e > 0 { self.loss(node, e.into()) } else { f32::MIN };
        let divisible = leaves.iter().enumerate().filter(|(_, (node, e))| *e > 0 && self.forest.level_of(*node) > 0);
        let Some(most) = divisible.max_by(|a, b| loss(a.1).total_cmp(&loss(b.1)).then(b.0.cmp(&a.0))).map(|(i, _)| i)
        else {
            return false;
        };
        let (node, e) = leaves[most];
        let children: Vec<Leaf> =
            self.forest.children(self.forest.level_of(node), node).map(|child| (child, 1)).collect();
        let mut excess = children.len().saturating_sub(usize::from(e) + *left);
        let others = leaves.iter().enumerate().filter(|(i, (_, e))| *i != most && *e > 1);
        let spare: usize = others.map(|(_, (_, e))| usize::from(*e) - 1).sum();
        if excess > spare {
            return false;
        }
        *left = (usize::from(e) + *left).saturating_sub(children.len());
        for (i, (_, e)) in leaves.iter_mut().enumerate() {
            while i != most && *e > 1 && excess > 0 {
                *e -= 1;
                excess -= 1;
            }
        }
        leaves.swap_remove(most);
        leaves.extend(children);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_kernels::random::Stream;

    const MOST: usize = 2;

    /// The least loss of a tree with each number of Gaussians, by trying all ways to share them among its children.
    fn best(forest: &Forest, losses: &[f32], level: u8, node: usize) -> Vec<f64> {
        let mut own = vec![f64::INFINITY; MOST + 1];
        (1..=MOST).for_each(|e| own[e] = f64::from(losses[node * (1 + MOST) + e]));
        if level > 0 {
            let children = forest.children(level, node).map(|child| best(forest, losses, level - 1, child));
            let divided = children.reduce(|a, b| join(&a, &b)).unwrap();
            own.resize(own.len().max(divided.len()), f64::INFINITY);
            own.iter_mut().zip(divided).for_each(|(own, divided)| *own = own.min(divided));
        }
        own
    }

    fn join(a: &[f64], b: &[f64]) -> Vec<f64> {
        let mut all = vec![f64::INFINITY; a.len() + b.len() - 1];
        for (i, a) in a.iter().enumerate() {
            b.iter().enumerate().for_each(|(j, b)| all[i + j] = all[i + j].min(a + b));
        }
        all
    }

    #[test]
    fn nothing_is_better_on_the_convex_hull() {
        for seed in 0..20 {
            let forest = Forest::new(2, 5, 18);
            let stream = Stream::new(seed, 0, "distortion");
            // The larger the cell, the more is lost; two Gaussians lose less than one, and there is no cell without.
            let loss = |i: usize| {
                let (_, cell) = forest.cell(i / (1 + MOST));
                let area = (cell.rows(5).len() * cell.columns(18).len()) as f32;
                area.powf(1.4) * stream.uniform::<f32>(i as u64) / (i % (1 + MOST)) as f32
            };
            let losses: Vec<f32> = (0..forest.nodes() * (1 + MOST)).map(loss).collect();
            let optimum = forest
                .level(COARSEST)
                .map(|root| best(&forest, &losses, COARSEST, root))
                .reduce(|a, b| join(&a, &b))
                .unwrap();
            let pruning = Pruning::new(&forest, &losses, MOST);
            let fewest = optimum.iter().position(|d| d.is_finite()).unwrap();
            for budget in fewest..=180 {
                let leaves = pruning.leaves(budget);
                let lost: f64 = leaves.iter().map(|&(node, e)| f64::from(pruning.loss(node, e.into()))).sum();
                assert_eq!(leaves.iter().map(|(_, e)| usize::from(*e)).sum::<usize>(), budget);
                assert!(lost > optimum[budget] - 1e-4, "seed {seed}, {budget}: {lost} below the optimum");
                // A vertex of the hull: no mix of a smaller and a larger count does better.
                let above = |i: usize| (optimum[i] - optimum[budget]) / (i as f64 - budget as f64);
                let steepest_after = (budget + 1..optimum.len()).map(above).fold(f64::INFINITY, f64::min);
                let flattest_before = (fewest..budget).map(above).fold(f64::NEG_INFINITY, f64::max);
                if flattest_before + 1e-4 < steepest_after.min(0.0) {
                    assert!(lost < optimum[budget] + 1e-3, "seed {seed}, {budget}: {lost}, not {}", optimum[budget]);
                }
            }
        }
    }
}
