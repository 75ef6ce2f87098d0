//! Names of allocations, as configurations and command lines give them.

use super::{Allocation, Argmax, Dithered, Fixed, Grid, Quadtree, QuadtreeGrid, Random, Sampled};
use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;
use weaver_autograd::Real;

/// The exponent of the learned density that measured best.
const GAMMA: f64 = 0.7;

/// An allocation by name: `sampled`, `argmax`, `quadtree`, `quadtree-grid`, `dithered`, `grid`, `random` or
/// `fixed:<Gaussians per pixel>`.
///
/// ```
/// use weaver_router::AllocationKind;
/// let kind: AllocationKind = "fixed:2".parse().unwrap();
/// assert_eq!((kind, kind.to_string().as_str(), kind.has_budget()), (AllocationKind::Fixed(2), "fixed:2", false));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AllocationKind {
    /// [`Sampled`].
    Sampled,
    /// [`Argmax`].
    Argmax,
    /// [`Quadtree`].
    Quadtree,
    /// [`QuadtreeGrid`].
    QuadtreeGrid,
    /// [`Dithered`].
    Dithered,
    /// [`Grid`].
    Grid,
    /// [`Random`].
    Random,
    /// [`Fixed`], with its expert.
    Fixed(u8),
}

/// Why there is no such allocation.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AllocationError {
    /// No allocation has this name.
    #[error(
        "allocation `{0}`: expected sampled, argmax, quadtree, quadtree-grid, dithered, grid, random or fixed:<number>"
    )]
    Unknown(String),
    /// A budget outside its range.
    #[error("allocation {kind}: expected a budget of 0 to {most} Gaussians per pixel, found {found}")]
    Budget {
        /// The allocation.
        kind: AllocationKind,
        /// The largest budget that it can spend.
        most: usize,
        /// The budget given.
        found: f64,
    },
    /// An expert that the model does not have.
    #[error("allocation {kind}: expected at most {most} Gaussians per pixel, the most that the model can make")]
    Expert {
        /// The allocation.
        kind: AllocationKind,
        /// The model's largest expert.
        most: usize,
    },
}

impl AllocationKind {
    /// True if the number of Gaussians is set by a budget, not by the router or the kind itself.
    pub fn has_budget(self) -> bool {
        matches!(self, Self::Quadtree | Self::QuadtreeGrid | Self::Dithered | Self::Grid | Self::Random)
    }

    /// The experts that pixels may get from this allocation, of a model whose largest is `most`; expert 0, which makes
    /// nothing, aside.
    ///
    /// ```
    /// use weaver_router::AllocationKind;
    /// assert_eq!(AllocationKind::Argmax.experts(3), 1..=3);
    /// assert_eq!((AllocationKind::Dithered.experts(3), AllocationKind::Fixed(2).experts(3)), (1..=1, 2..=2));
    /// assert!(AllocationKind::Fixed(0).experts(3).is_empty());
    /// ```
    pub fn experts(self, most: u8) -> RangeInclusive<u8> {
        match self {
            Self::Sampled | Self::Argmax | Self::Quadtree => 1..=most,
            Self::QuadtreeGrid => 1..=1,
            Self::Dithered | Self::Grid | Self::Random => 1..=1,
            Self::Fixed(expert) => expert.max(1)..=expert,
        }
    }

    /// The allocation of this name, for a model of `experts` experts (expert 0 included); `budget` is the number of
    /// Gaussians per pixel where there is one to set. Fails on a budget outside 0 to 1 (to M for `quadtree`) and on an
    /// expert that the model does not have.
    pub fn allocation<T: Real>(self, budget: f64, experts: usize) -> Result<Box<dyn Allocation<T>>, AllocationError> {
        let most = if self == Self::Quadtree { experts.saturating_sub(1) } else { 1 };
        if self.has_budget() && !(0.0..=most as f64).contains(&budget) {
            return Err(AllocationError::Budget { kind: self, most, found: budget });
        }
        Ok(match self {
            Self::Sampled => Box::new(Sampled),
            Self::Argmax => Box::new(Argmax),
            Self::Quadtree => Box::new(Quadtree { budget }),
            Self::QuadtreeGrid => Box::new(QuadtreeGrid { budget }),
            Self::Dithered => Box::new(Dithered { budget, gamma: GAMMA }),
            Self::Grid => Box::new(Grid { budget }),
            Self::Random => Box::new(Random { budget }),
            Self::Fixed(expert) if usize::from(expert) < experts => Box::new(Fixed { expert }),
            Self::Fixed(_) => return Err(AllocationError::Expert { kind: self, most: experts.saturating_sub(1) }),
        })
    }
}

impl FromStr for AllocationKind {
    type Err = AllocationError;

    fn from_str(name: &str) -> Result<Self, AllocationError> {
        let unknown = || AllocationError::Unknown(name.to_owned());
        Ok(match name {
            "sampled" => Self::Sampled,
            "argmax" => Self::Argmax,
            "quadtree" => Self::Quadtree,
            "quadtree-grid" => Self::QuadtreeGrid,
            "dithered" => Self::Dithered,
            "grid" => Self::Grid,
            "random" => Self::Random,
            _ => {
                let expert = name.strip_prefix("fixed:").ok_or_else(unknown)?;
                Self::Fixed(expert.parse().map_err(|_| unknown())?)
            }
        })
    }
}

impl fmt::Display for AllocationKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sampled => f.write_str("sampled"),
            Self::Argmax => f.write_str("argmax"),
            Self::Quadtree => f.write_str("quadtree"),
            Self::QuadtreeGrid => f.write_str("quadtree-grid"),
            Self::Dithered => f.write_str("dithered"),
            Self::Grid => f.write_str("grid"),
            Self::Random => f.write_str("random"),
            Self::Fixed(expert) => write!(f, "fixed:{expert}"),
        }
    }
}
