//! The interface of a primitive to the tile layer.

use super::record;
use std::fmt;
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, LaneMask, Lanes, Vector};

/// Projects primitives into records, sixteen at a time.
///
/// A record is all that a view needs of a primitive: sixteen numbers, one cache line in `f32`. The tile layer reads the
/// depth and the color in it ([`record`]); the other numbers belong to the primitive.
pub trait Projection<T: Real>: Sync {
    /// Values computed once for many primitives of one view, such as the camera in vector registers.
    type State<V: Lanes<Scalar = T>>;

    /// Prepares the projection of primitives into view `view`.
    fn begin<V: Lanes<Scalar = T>>(&self, view: usize) -> Self::State<V>;

    /// Projects primitives `first..first + count`, `count` from 1 to 16; lanes beyond `count` must not be seen or
    /// rejected.
    fn project<V: Lanes<Scalar = T>>(&self, state: &mut Self::State<V>, first: usize, count: usize) -> Projected<V>;
}

/// Sixteen primitives as one view sees them, made by a [`Projection`].
#[derive(Clone, Copy)]
pub struct Projected<V: Lanes> {
    /// The records as columns: `columns[k]` holds number k of each of the sixteen.
    pub columns: [V; LANES],
    /// The primitives that may be visible. The others get no place in any list.
    pub seen: V::Mask,
    /// The primitives that are left out because they hold, or lead to, numbers that are not finite.
    pub rejected: V::Mask,
}

impl<V: Lanes> fmt::Debug for Projected<V> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Projected").field("seen", &self.seen.bits()).finish_non_exhaustive()
    }
}

impl<V: Lanes> Projected<V> {
    /// Primitives that were projected one by one: `None` for invisible ones.
    pub fn from_records(records: [Option<[V::Scalar; LANES]>; LANES]) -> Self {
        let number = |lane: usize, k: usize| records[lane].map_or(V::Scalar::ZERO, |numbers| numbers[k]);
        let seen =
            records.iter().enumerate().fold(0, |bits, (lane, record)| bits | u16::from(record.is_some()) << lane);
        Self {
            columns: std::array::from_fn(|k| V::from_fn(|lane| number(lane, k))),
            seen: V::Mask::from_bits(seen),
            rejected: V::Mask::from_bits(0),
        }
    }

    /// The camera depth that orders the primitives of a pixel.
    #[inline(always)]
    pub(crate) fn depth(&self) -> V {
        self.columns[record::DEPTH]
    }
}

/// The pixels that a primitive may cover: its outline, rounded outward.
///
/// Pixels outside the outline never see the primitive. Pixels inside decide for themselves ([`Response::at`]), so that
/// a generous outline costs time and changes no image.
pub trait Footprint: Sync {
    /// The smallest and the largest y of the outlines of sixteen primitives, in pixels. Pixel centers are at +0.5.
    fn rows<V: Lanes>(&self, columns: &[V; LANES]) -> (V, V);

    /// The smallest and the largest x of the outlines between two rows of pixel centers at y = `top` and y = `bottom`,
    /// and which outlines reach these rows at all.
    fn span<V: Lanes>(&self, columns: &[V; LANES], top: V, bottom: V) -> (V, V, V::Mask);

    /// The second interval of x, as [`span`](Self::span), of outlines that the seam of a panorama cuts in two; by
    /// default there is none.
    #[inline(always)]
    fn second_span<V: Lanes>(&self, _columns: &[V; LANES], _top: V, _bottom: V) -> Option<(V, V, V::Mask)> {
        None
    }
}

/// Response of a primitive at a pixel, and its gradient.
///
/// The inner loop of blending is monomorphized over this trait; implementations should mark every method
/// `#[inline(always)]`.
pub trait Response: Sync {
    /// Number of sums over pixels for the gradient of the primitive's shape, at most [`MAX_SUMS`]. With more than
    /// [`MAX_SUMS_WITH_STATISTICS`] there is no room for statistics.
    const SUMS: usize;
    /// True if there is a form of blending without depth for calls that do not ask for it, which is more to compile.
    /// Otherwise depth is always blended. Images and gradients are the same.
    const WITHOUT_DEPTH: bool = false;

    /// A primitive's numbers, each in all lanes.
    type Loaded<V: Vector>: Copy;
    /// Values of a primitive at a vector of pixels that [`backward`](Self::backward) needs.
    type Sample<V: Vector>: Copy;
    /// Numbers that all primitives share at pixels with these x, such as the sine and cosine of an azimuth; x itself
    /// will do.
    type Column<V: Vector>: Copy;
    /// Numbers that all primitives share at pixels with these y.
    type Line<V: Vector>: Copy;

    /// Prepares pixels whose centers have these x. Called once for each window and column of blocks, not for each
    /// primitive.
    fn column<V: Vector>(&self, x: V) -> Self::Column<V>;

    /// Prepares pixels whose centers have these y.
    fn line<V: Vector>(&self, y: V) -> Self::Line<V>;

    /// Loads a primitive from its record.
    fn load<V: Vector>(&self, record: &[V::Scalar; LANES]) -> Self::Loaded<V>;

    /// The alpha of a primitive at the pixel centers of a column and a line, before it is capped.
    fn at<V: Vector>(
        &self,
        primitive: &Self::Loaded<V>,
        column: &Self::Column<V>,
        line: &Self::Line<V>,
    ) -> (V, Self::Sample<V>);

    /// The depth at the pixels of a sample, finite also where alpha is zero. `center` is the depth of the record, which
    /// all pixels have by default.
    #[inline(always)]
    fn depth<V: Vector>(&self, _sample: &Self::Sample<V>, center: V) -> V {
        center
    }

    /// Adds the gradients from the pixels to the numbers that alpha depends on. `g` is alpha dL/dalpha, the gradient
    /// with respect to the logarithm of alpha. The primitive decides the meaning of the [`SUMS`](Self::SUMS) sums over
    /// pixels.
    fn backward<V: Vector>(&self, sample: &Self::Sample<V>, g: V, sums: &mut [V]);

    /// Adds the gradients from the pixels to the numbers that [`depth`](Self::depth) depends on; `g` is the gradient
    /// with respect to the depth at each pixel. By default none: the gradient with respect to a record's depth is
    /// summed anyway.
    #[inline(always)]
    fn depth_backward<V: Vector>(&self, _sample: &Self::Sample<V>, _g: V, _sums: &mut [V]) {}

    /// The gradient with respect to the primitive's position on the image, in pixels, that each pixel contributes; zero
    /// by default. Used by statistics only.
    #[inline(always)]
    fn screen_gradient<V: Vector>(&self, _primitive: &Self::Loaded<V>, _sample: &Self::Sample<V>, _g: V) -> [V; 2] {
        [V::zero(); 2]
    }
}

/// Largest number of sums over pixels that a primitive may have for the gradient of its shape: a row has sixteen
/// places, and color and depth take four.
pub const MAX_SUMS: usize = LANES - 4;

/// Largest number of such sums of primitives with statistics, which take four places more.
pub const MAX_SUMS_WITH_STATISTICS: usize = MAX_SUMS - 4;
