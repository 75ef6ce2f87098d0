//! Adaptive models of order 0: symbols by how often they came before.

use crate::range::{Coder, Slices, WHOLE};

/// Frequencies of symbols so far, each with ½ added (Krichevsky and Trofimov): nothing has to be sent before the
/// symbols.
///
/// Of `N` symbols over an alphabet of `n`, with counts `c_i`, the code length is
/// `-log2(Γ(n/2) / Γ(N + n/2) · Π Γ(c_i + ½) / Γ(½))`, but for the rounding to parts of 2^16.
///
/// ```
/// use weaver_codec::{AdaptiveModel, CodeLength};
///
/// let (mut model, mut length) = (AdaptiveModel::new(2), CodeLength::default());
/// model.code(&mut length, 0);
/// assert!((length.bits - 1.0).abs() < 1e-3);
/// model.code(&mut length, 0); // now (1 + ½) / (1 + 1)
/// assert!((length.bits - 1.0 + 0.75_f64.log2()).abs() < 1e-3);
/// ```
#[derive(Clone, Debug)]
pub struct AdaptiveModel {
    /// Twice the frequencies plus one, as a tree of partial sums (Fenwick), from index 1 on.
    tree: Vec<u64>,
    total: u64,
}

impl AdaptiveModel {
    /// A model before the first symbol.
    ///
    /// # Panics
    /// For an alphabet of no symbols or more than 2^15.
    pub fn new(symbols: usize) -> Self {
        assert!((1..=1 << 15).contains(&symbols), "expected 1 to 2^15 symbols, found {symbols}");
        let tree = (0..=symbols as u64).map(|i| i & i.wrapping_neg()).collect();
        Self { tree, total: symbols as u64 }
    }

    /// Symbols of the alphabet.
    pub fn symbols(&self) -> usize {
        self.tree.len() - 1
    }

    /// Codes a symbol and counts it.
    pub fn code(&mut self, coder: &mut impl Coder, symbol: usize) -> usize {
        let symbol = coder.symbol(self, symbol);
        self.count(symbol);
        symbol
    }

    fn count(&mut self, symbol: usize) {
        let mut at = symbol + 1;
        while at < self.tree.len() {
            self.tree[at] += 2;
            at += at & at.wrapping_neg();
        }
        self.total += 2;
    }

    /// The first part of a symbol: one for each symbol before it, and its share of the others.
    fn first(&self, symbol: usize, before: u64) -> u32 {
        // Below 2^48 symbols, products are below 2^64.
        let spare = u64::from(WHOLE) - self.symbols() as u64;
        (symbol as u64 + before * spare / self.total) as u32
    }

    /// Sum of the numbers of all symbols before one.
    fn before(&self, symbol: usize) -> u64 {
        let (mut at, mut sum) = (symbol, 0);
        while at > 0 {
            sum += self.tree[at];
            at &= at - 1;
        }
        sum
    }
}

impl Slices for AdaptiveModel {
    fn slice(&self, symbol: usize) -> (u32, u32) {
        let first = self.first(symbol, self.before(symbol));
        (first, self.first(symbol + 1, self.before(symbol + 1)) - first)
    }

    fn at(&self, part: u32) -> usize {
        let (mut symbol, mut before) = (0, 0);
        let mut step = self.symbols().next_power_of_two();
        while step > 0 {
            let next = symbol + step;
            // The symbol behind the last one begins at 2^16, beyond any part.
            if next <= self.symbols() && self.first(next, before + self.tree[next]) <= part {
                symbol = next;
                before += self.tree[next];
            }
            step /= 2;
        }
        symbol
    }
}
