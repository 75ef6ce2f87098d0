//! Gaussians a block at a time, so that scenes pass through that do not fit into memory.

use crate::Result;
use std::borrow::Cow;
use std::ops::Range;
use weaver_scene::Gaussians;

/// Gaussians of a block: four megabytes of degree 3.
const BLOCK: usize = 1 << 14;

/// Gaussians that can be read in parts: in memory, or rows of a file.
pub trait Blocks {
    /// Number of Gaussians.
    fn len(&self) -> usize;

    /// Degree of the spherical harmonics, 0 to 4.
    fn degree(&self) -> usize;

    /// The Gaussians of these numbers, which are below [`len`](Self::len).
    ///
    /// # Errors
    /// When the file cannot be read, or holds a value there that a renderer cannot use.
    fn block(&self, rows: Range<usize>) -> Result<Cow<'_, Gaussians>>;

    /// True if there are no Gaussians.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The numbers of Gaussians in blocks of some megabytes, in order.
    fn blocks(&self) -> Box<dyn Iterator<Item = Range<usize>>> {
        let count = self.len();
        Box::new((0..count).step_by(BLOCK).map(move |start| start..count.min(start + BLOCK)))
    }

    /// All Gaussians.
    ///
    /// # Errors
    /// As [`block`](Self::block).
    fn all(&self) -> Result<Cow<'_, Gaussians>> {
        let (n, degree) = (self.len(), self.degree());
        let mut all = Gaussians { degree, ..Gaussians::default() };
        all.means.reserve_exact(n);
        all.log_scales.reserve_exact(n);
        all.quats.reserve_exact(n);
        all.opacity_logits.reserve_exact(n);
        all.sh.reserve_exact(n * 3 * all.coefficients());
        for rows in self.blocks() {
            all.append(&*self.block(rows)?);
        }
        Ok(Cow::Owned(all))
    }

    /// All Gaussians, without a copy of those that are in memory.
    ///
    /// # Errors
    /// As [`block`](Self::block).
    fn into_all(self: Box<Self>) -> Result<Gaussians> {
        Ok(self.all()?.into_owned())
    }
}

impl Blocks for Gaussians {
    fn len(&self) -> usize {
        self.means.len()
    }

    fn degree(&self) -> usize {
        self.degree
    }

    fn block(&self, rows: Range<usize>) -> Result<Cow<'_, Gaussians>> {
        Ok(if rows == (0..self.means.len()) { Cow::Borrowed(self) } else { Cow::Owned(self.slice(rows)) })
    }

    fn all(&self) -> Result<Cow<'_, Gaussians>> {
        Ok(Cow::Borrowed(self))
    }

    fn into_all(self: Box<Self>) -> Result<Gaussians> {
        Ok(*self)
    }
}

impl<B: Blocks + ?Sized> Blocks for &B {
    fn len(&self) -> usize {
        (**self).len()
    }

    fn degree(&self) -> usize {
        (**self).degree()
    }

    fn block(&self, rows: Range<usize>) -> Result<Cow<'_, Gaussians>> {
        (**self).block(rows)
    }

    fn all(&self) -> Result<Cow<'_, Gaussians>> {
        (**self).all()
    }
}

/// Gaussians with a change applied to each, independently of the others.
pub struct Changed<'a> {
    /// Gaussians as they were.
    pub from: Box<dyn Blocks + 'a>,
    /// Degree of the harmonics that `change` leaves.
    pub degree: usize,
    /// The change of a block, which keeps the number of its Gaussians.
    pub change: Box<dyn Fn(&Gaussians) -> Gaussians + 'a>,
}

impl std::fmt::Debug for Changed<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Changed").field("len", &self.from.len()).field("degree", &self.degree).finish_non_exhaustive()
    }
}

impl Blocks for Changed<'_> {
    fn len(&self) -> usize {
        self.from.len()
    }

    fn degree(&self) -> usize {
        self.degree
    }

    fn block(&self, rows: Range<usize>) -> Result<Cow<'_, Gaussians>> {
        Ok(Cow::Owned((self.change)(&*self.from.block(rows)?)))
    }
}

/// Gaussians of several scenes, one scene after the other, with harmonics up to the largest degree among them.
pub struct Chained(pub Vec<Box<dyn Blocks>>);

impl std::fmt::Debug for Chained {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.0.iter().map(|part| part.len())).finish()
    }
}

impl Blocks for Chained {
    fn len(&self) -> usize {
        self.0.iter().map(|part| part.len()).sum()
    }

    fn degree(&self) -> usize {
        self.0.iter().map(|part| part.degree()).max().unwrap_or(0)
    }

    fn block(&self, rows: Range<usize>) -> Result<Cow<'_, Gaussians>> {
        let mut found = Gaussians { degree: self.degree(), ..Gaussians::default() };
        let mut first = 0;
        for part in &self.0 {
            let within = |row: usize| row.clamp(first, first + part.len()) - first;
            let some = within(rows.start)..within(rows.end);
            if !some.is_empty() {
                found.append(&*part.block(some)?);
            }
            first += part.len();
        }
        Ok(Cow::Owned(found))
    }
}
