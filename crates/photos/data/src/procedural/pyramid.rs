//! Images on surfaces, kept at every power of two of their size, so that a few rays a pixel see no aliasing.

use super::color::color;
use super::draws::Draws;
use weaver_geometry::glam::{DMat2, DVec2, DVec3, Vec3};

/// Texels of the largest level along each axis, a power of two.
const SIZE: usize = 128;
/// Leaves of an image: enough that hardly any of the ground shows.
const LEAVES: usize = 1100;
/// Radii of leaves, texels; between them the number of leaves falls with the third power, as in photos of nature.
const RADII: [f64; 2] = [1.5, 30.0];

/// A square image over the unit square, mirrored beyond it, so that it has no seams.
#[derive(Debug)]
pub(super) struct Pyramid {
    /// Each level half as wide as the one before; the last is a single texel.
    levels: Vec<Vec<Vec3>>,
}

impl Pyramid {
    /// Samples a function of the unit square, four times a texel.
    pub fn of(color: impl Fn(DVec2) -> DVec3) -> Self {
        let quarter = |x: usize, y: usize| color(DVec2::new(x as f64 + 0.5, y as f64 + 0.5) / (2 * SIZE) as f64);
        let fine: Vec<Vec3> = (0..4 * SIZE * SIZE).map(|i| quarter(i % (2 * SIZE), i / (2 * SIZE)).as_vec3()).collect();
        Self::new(halved(&fine))
    }

    /// Dead leaves: disks and rectangles of all sizes, strewn over one another, in a few colors.
    ///
    /// A model of photos: edges at every scale and occlusion everywhere (Lee, Mumford and Huang 2001).
    pub fn dead_leaves(draws: &mut Draws) -> Self {
        let palette: Vec<DVec3> = (0..3 + draws.below(5)).map(|_| any_color(draws)).collect();
        let mut texels = vec![palette[0].as_vec3(); SIZE * SIZE];
        for _ in 0..LEAVES {
            let smallest = 1.0 - (RADII[0] / RADII[1]).powi(2);
            let radius = RADII[0] / (1.0 - smallest * draws.within(0.0, 1.0)).sqrt();
            let shade = palette[draws.below(palette.len())] * draws.within(0.8, 1.2);
            let slope = draws.within(-0.25, 0.25);
            let axes = DMat2::from_diagonal(DVec2::new(1.0, draws.within(1.0, 2.5)) / radius)
                * DMat2::from_angle(draws.within(0.0, std::f64::consts::TAU));
            let center = DVec2::new(draws.within(0.0, 1.0), draws.within(0.0, 1.0)) * SIZE as f64;
            let round = draws.chance(0.6);
            // The corners of a rectangle are farther out than the rim of a disk.
            let reach = if round { radius } else { radius * std::f64::consts::SQRT_2 };
            let from = (center - reach).max(DVec2::ZERO).as_usizevec2();
            let to = (center + reach + 1.0).as_usizevec2().min([SIZE; 2].into());
            for y in from.y..to.y {
                for x in from.x..to.x {
                    let p = axes * (DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - center);
                    if if round { p.length_squared() < 1.0 } else { p.abs().max_element() < 1.0 } {
                        texels[y * SIZE + x] = (shade * (1.0 + slope * p.x)).as_vec3();
                    }
                }
            }
        }
        Self::new(texels)
    }

    fn new(texels: Vec<Vec3>) -> Self {
        let mut levels = vec![texels];
        while levels[levels.len() - 1].len() > 1 {
            levels.push(halved(&levels[levels.len() - 1]));
        }
        Self { levels }
    }

    /// The color at `p` as seen by a ray that covers `footprint` (both in widths of the image): bilinear, at the level
    /// whose texels are about as large.
    pub fn at(&self, p: DVec2, footprint: f64) -> DVec3 {
        let level = (footprint * SIZE as f64).log2().round().clamp(0.0, (self.levels.len() - 1) as f64) as usize;
        let texels = &self.levels[level];
        let size = SIZE >> level;
        let p = p * size as f64 - 0.5;
        let base = p.floor();
        let fraction = (p - base).as_vec2();
        let (columns, rows) = (mirrored(base.x, size), mirrored(base.y, size));
        let row = |y: usize| texels[y * size + columns[0]].lerp(texels[y * size + columns[1]], fraction.x);
        row(rows[0]).lerp(row(rows[1]), fraction.y).as_dvec3()
    }
}

/// Places of texel `at` and of the one after it in an image that is mirrored at its borders.
fn mirrored(at: f64, size: usize) -> [usize; 2] {
    let fold = |i: i64| {
        let i = i as usize & (2 * size - 1);
        i.min(2 * size - 1 - i)
    };
    [fold(at as i64), fold(at as i64 + 1)]
}

/// A square image at half its width: means of two by two texels.
fn halved(texels: &[Vec3]) -> Vec<Vec3> {
    let wide = texels.len().isqrt();
    let size = wide / 2;
    let mean = |x: usize, y: usize| {
        let at = 2 * y * wide + 2 * x;
        (texels[at] + texels[at + 1] + texels[at + wide] + texels[at + wide + 1]) / 4.0
    };
    (0..size * size).map(|i| mean(i % size, i / size)).collect()
}

fn any_color(draws: &mut Draws) -> DVec3 {
    color(draws.within(0.0, 1.0), draws.within(0.0, 0.9), draws.within(0.0, 1.0).powi(2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_kernels::random::Stream;

    /// Every level has the mean of the image and mirroring has no seams.
    #[test]
    fn levels_keep_the_mean_without_seams() {
        let image = Pyramid::dead_leaves(&mut Draws::new(Stream::new(1, 0, "test")));
        assert_eq!(image.levels.len(), 8);
        let mean = |texels: &[Vec3]| texels.iter().sum::<Vec3>() / texels.len() as f32;
        let whole = image.levels[7][0];
        assert!(image.levels.iter().all(|level| mean(level).abs_diff_eq(whole, 1e-4)));
        let spread = image.levels[0].iter().map(|c| c.distance_squared(whole)).sum::<f32>() / (SIZE * SIZE) as f32;
        assert!(spread > 0.005, "{spread}");
        for (a, b) in [(0.3, -0.3), (0.9, 1.1), (0.25, 2.25), (-1.75, 0.25)] {
            let (a, b) = (DVec2::new(a, 0.4), DVec2::new(b, 0.4));
            assert!((image.at(a, 0.01) - image.at(b, 0.01)).length() < 1e-5);
        }
        assert!((image.at(DVec2::ONE, 3.0) - whole.as_dvec3()).length() < 1e-6);
    }

    #[test]
    fn a_function_is_sampled_where_it_is() {
        let image = Pyramid::of(|p| p.extend(0.5));
        let p = DVec2::new(0.37, 0.61);
        assert!((image.at(p, 0.0) - p.extend(0.5)).length() < 1e-5);
    }
}
