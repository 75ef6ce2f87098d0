//! Gaussians worth keeping: by their place, by their coverage, and by their neighbors.

use crate::{Gaussians, forms};
use std::str::FromStr;
use weaver_kernels::nearest_neighbors::nearest_neighbors;
use weaver_kernels::order::median_high;

/// A part of space.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Region {
    /// The points between two corners, world units.
    Box {
        /// The least coordinates.
        min: [f32; 3],
        /// The largest coordinates.
        max: [f32; 3],
    },
    /// The points at most a radius away from a center, world units.
    Sphere {
        /// The center.
        center: [f32; 3],
        /// The radius, not negative.
        radius: f32,
    },
}

/// Six numbers with commas between, two corners of a box, or four, the center and the radius of a sphere.
///
/// ```
/// use weaver_scene::Region;
/// assert_eq!("0,0,2,1.5".parse(), Ok(Region::Sphere { center: [0.0, 0.0, 2.0], radius: 1.5 }));
/// assert!("1,2,3".parse::<Region>().is_err());
/// ```
impl FromStr for Region {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split(',').map(|part| part.trim().parse().ok().filter(|x: &f64| x.is_finite()));
        match numbers.map(|x| Some(x? as f32)).collect::<Option<Vec<f32>>>().as_deref() {
            Some(&[a, b, c, d, e, f]) => {
                let corners = [[a, d], [b, e], [c, f]];
                Ok(Self::Box { min: corners.map(|[a, b]| a.min(b)), max: corners.map(|[a, b]| a.max(b)) })
            }
            Some(&[x, y, z, radius]) if radius >= 0.0 => Ok(Self::Sphere { center: [x, y, z], radius }),
            _ => {
                Err("expected six numbers, the corners of a box, or four, the center and the radius of a sphere".into())
            }
        }
    }
}

impl Region {
    /// True if a point lies within, or on the border.
    ///
    /// ```
    /// use weaver_scene::Region;
    /// let ball = Region::Sphere { center: [0.0; 3], radius: 1.0 };
    /// assert!(ball.contains([0.0, 1.0, 0.0]) && !ball.contains([1.0, 1.0, 0.0]));
    /// ```
    pub fn contains(&self, point: [f32; 3]) -> bool {
        match self {
            Self::Box { min, max } => (0..3).all(|i| (min[i]..=max[i]).contains(&point[i])),
            Self::Sphere { center, radius } => squared_distance(point, *center) <= radius * radius,
        }
    }
}

fn squared_distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// Opacity below which a Gaussian changes no pixel.
const LEAST_OPACITY: f32 = 1.0 / 255.0;
/// Neighbors by which a floater is recognized.
const NEIGHBORS: usize = 8;
/// Standard deviations of the logarithm of a distance beyond which a Gaussian is a floater.
const DEVIATIONS: f32 = 3.0;
/// A distance that many times the median is none of a floater, however even the others are.
const EVEN: f32 = 4.0;
/// The standard deviation of normally distributed numbers in units of their median absolute deviation.
const NORMAL: f32 = 1.4826;

impl Gaussians {
    /// Numbers of the Gaussians whose centers lie in a region, in their order.
    pub fn inside(&self, region: &Region) -> Vec<usize> {
        (0..self.len()).filter(|&i| region.contains(self.means[i])).collect()
    }

    /// Numbers of the Gaussians that can show, in their order: those with an opacity of at least 1/255, below which
    /// nothing is drawn.
    ///
    /// ```
    /// use weaver_scene::{Gaussians, forms};
    /// let two = Gaussians {
    ///     means: vec![[0.0; 3]; 2],
    ///     log_scales: vec![[-1.0; 3]; 2],
    ///     quats: vec![[1.0, 0.0, 0.0, 0.0]; 2],
    ///     opacity_logits: vec![forms::opacity_logit(0.003), forms::opacity_logit(0.5)],
    ///     sh: vec![0.0; 6],
    ///     degree: 0,
    /// };
    /// assert_eq!(two.visible(), [1]);
    /// ```
    pub fn visible(&self) -> Vec<usize> {
        (0..self.len()).filter(|&i| forms::opacity(self.opacity_logits[i]) >= LEAST_OPACITY).collect()
    }

    /// The opacity of each Gaussian times the area that it covers from its broadest side, `opacity * s_1 * s_2` of the
    /// two largest standard deviations; world units squared, `[N]`.
    pub fn importance(&self) -> Vec<f32> {
        let area = |log_scales: &[f32; 3]| {
            let least = log_scales.iter().copied().fold(f32::INFINITY, f32::min);
            (log_scales.iter().sum::<f32>() - least).exp()
        };
        self.log_scales.iter().zip(&self.opacity_logits).map(|(s, o)| forms::opacity(*o) * area(s)).collect()
    }

    /// Numbers of the `count` Gaussians with the largest of some `values` `[N]`, in their order; of equal ones the
    /// first.
    ///
    /// # Panics
    /// When there is not a value for each Gaussian.
    pub fn largest(&self, values: &[f32], count: usize) -> Vec<usize> {
        assert_eq!(values.len(), self.len(), "largest: a value for each Gaussian");
        let mut order: Vec<usize> = (0..self.len()).collect();
        order.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
        order.truncate(count);
        order.sort_unstable();
        order
    }

    /// Numbers of the Gaussians that are no floaters, in their order.
    ///
    /// A floater is unusually far from others: the logarithm of the distance to its eighth neighbor is more than three
    /// robust standard deviations (1.4826 times the median absolute deviation) above the median of all, and the
    /// distance more than four times the median. At most eight Gaussians have none.
    pub fn without_floaters(&self) -> Vec<usize> {
        let all = (0..self.len()).collect();
        if self.len() <= NEIGHBORS {
            return all;
        }
        let mut neighbors = vec![0; self.len() * (1 + NEIGHBORS)];
        nearest_neighbors(self.means.as_flattened(), NEIGHBORS, &mut neighbors);
        let distance = |row: &[u32]| {
            let to = |i: usize| self.means[row[i] as usize];
            // Several at one place have a distance of zero, whose logarithm is to stay a number.
            0.5 * squared_distance(to(0), to(NEIGHBORS)).max(f32::MIN_POSITIVE).ln()
        };
        let distances: Vec<f32> = neighbors.chunks_exact(1 + NEIGHBORS).map(distance).collect();
        let median = |mut values: Vec<f32>| median_high(&mut values).expect("a distance of each");
        let middle = median(distances.clone());
        let spread = median(distances.iter().map(|d| (d - middle).abs()).collect());
        let most = middle + (DEVIATIONS * NORMAL * spread).max(EVEN.ln());
        (0..self.len()).filter(|&i| distances[i] <= most).collect()
    }
}
