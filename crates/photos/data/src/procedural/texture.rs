//! Surface colors: flat areas and fine detail, as functions of surface coordinates.

use super::color::color;
use super::draws::Draws;
use super::pyramid::Pyramid;
use std::sync::Arc;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_kernels::random::Stream;

/// Letters as rows of five dots, the leftmost in bit 4.
const GLYPHS: [[u8; 7]; 8] = [
    [0b01110, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001],
    [0b11111, 0b10000, 0b10000, 0b11110, 0b10000, 0b10000, 0b11111],
    [0b10001, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001],
    [0b10001, 0b10010, 0b10100, 0b11000, 0b10100, 0b10010, 0b10001],
    [0b10001, 0b11001, 0b10101, 0b10011, 0b10001, 0b10001, 0b10001],
    [0b11110, 0b10001, 0b10001, 0b11110, 0b10100, 0b10010, 0b10001],
    [0b01111, 0b10000, 0b10000, 0b01110, 0b00001, 0b00001, 0b11110],
    [0b11111, 0b00001, 0b00010, 0b00100, 0b01000, 0b10000, 0b11111],
];

#[derive(Clone, Debug)]
enum Pattern {
    Flat,
    Checks,
    Stripes(DVec2),
    Noise,
    Glyphs,
    /// An image with this point at the origin.
    Image(Arc<Pyramid>, DVec2),
}

/// A pattern in two colors.
#[derive(Clone, Debug)]
pub(super) struct Texture {
    pattern: Pattern,
    /// Scene units in which the pattern repeats, over which noise changes, or that an image is wide.
    period: f64,
    /// Linear light, of the darkest and the lightest that the pattern has.
    colors: [DVec3; 2],
    stream: Stream,
}

impl Texture {
    /// A texture for a large surface: always patterned, so that its pose and depth can be seen.
    pub fn wide(draws: &mut Draws) -> Self {
        let kind = 1 + draws.below(4);
        Self::of_kind(kind, 1.5, draws)
    }

    /// A texture for an object: one in five is flat.
    pub fn small(draws: &mut Draws) -> Self {
        let kind = draws.below(5);
        Self::of_kind(kind, 1.0, draws)
    }

    /// One of some images, in colors of its own, from `smallest` to three times as many scene units wide.
    ///
    /// Surfaces differ more from one another than within themselves, as they do in photos: one in twelve is flat, and
    /// others nearly so.
    pub fn image(images: &[Arc<Pyramid>], smallest: f64, draws: &mut Draws) -> Self {
        let image = images[draws.below(images.len())].clone();
        let shift = DVec2::new(draws.within(0.0, 2.0), draws.within(0.0, 2.0));
        let mut any = |low, high| color(draws.within(0.0, 1.0), draws.within(0.0, 0.8), draws.within(low, high));
        let (base, dark, light) = (any(0.0, 1.0), any(0.0, 0.15), any(0.5, 1.2));
        let base = base * base.max_element();
        let contrast = if draws.chance(1.0 / 12.0) { 0.0 } else { draws.within(0.1, 0.9) };
        let period = smallest * 3.0_f64.powf(draws.within(0.0, 1.0));
        let colors = [base.lerp(dark, contrast), base.lerp(light, contrast)];
        Self { pattern: Pattern::Image(image, shift), period, colors, stream: draws.stream() }
    }

    fn of_kind(kind: usize, size: f64, draws: &mut Draws) -> Self {
        let (pattern, low, high) = match kind {
            0 => (Pattern::Flat, 1.0, 1.0),
            1 => (Pattern::Checks, 0.4, 0.8),
            2 => {
                let angle = draws.within(0.0, std::f64::consts::PI);
                (Pattern::Stripes(DVec2::from_angle(angle)), 0.3, 0.6)
            }
            3 => (Pattern::Noise, 0.2, 0.5),
            _ => (Pattern::Glyphs, 0.4, 0.7),
        };
        let period = size * draws.within(low, high);
        let hue = draws.within(0.0, 1.0);
        // The second color is far in brightness or far in hue, so that every pattern shows.
        let other = hue + draws.within(0.2, 0.8);
        let dark = color(hue, draws.within(0.2, 0.8), draws.within(0.08, 0.3));
        let light = color(other, draws.within(0.1, 0.7), draws.within(0.5, 0.95));
        let colors = if draws.chance(0.5) { [dark, light] } else { [light, dark] };
        Self { pattern, period, colors, stream: draws.stream() }
    }

    /// The color at surface coordinates `uv`, linear light; of an image, its mean over about `footprint` scene units.
    pub fn color(&self, uv: DVec2, footprint: f64) -> DVec3 {
        let p = uv / self.period;
        let mix = match &self.pattern {
            Pattern::Flat => 0.0,
            Pattern::Checks => f64::from(((p.x * 2.0).floor() + (p.y * 2.0).floor()).rem_euclid(2.0) >= 1.0),
            Pattern::Stripes(direction) => f64::from(p.dot(*direction).rem_euclid(1.0) < 0.5),
            Pattern::Noise => (self.noise(p) + 0.5 * self.noise(p * 2.0 + DVec2::splat(37.0))) / 1.5,
            Pattern::Glyphs => f64::from(self.glyph(p)),
            Pattern::Image(image, shift) => {
                let range = self.colors[1] - self.colors[0];
                return self.colors[0] + range * image.at(p + *shift, footprint / self.period);
            }
        };
        self.colors[0].lerp(self.colors[1], mix)
    }

    /// A random value in (0, 1) for a cell of the integer lattice.
    fn cell(&self, x: f64, y: f64) -> f64 {
        self.stream.uniform(cell_index(x, y))
    }

    /// Value noise: random values at integer points, smoothly blended between them.
    fn noise(&self, p: DVec2) -> f64 {
        let base = p.floor();
        let f = p - base;
        let f = f * f * (DVec2::splat(3.0) - 2.0 * f);
        let row = |y: f64| {
            let (a, b) = (self.cell(base.x, y), self.cell(base.x + 1.0, y));
            a + (b - a) * f.x
        };
        let (a, b) = (row(base.y), row(base.y + 1.0));
        a + (b - a) * f.y
    }

    /// True if a dot of a letter covers `p`: one letter of 5 x 7 dots per cell of 6 x 8.
    fn glyph(&self, p: DVec2) -> bool {
        let cell = p.floor();
        let dot = (p - cell) * DVec2::new(6.0, 8.0);
        let (column, row) = (dot.x as usize, dot.y as usize);
        let letter = GLYPHS[self.stream.below(cell_index(cell.x, cell.y), GLYPHS.len())];
        column < 5 && row < 7 && letter[6 - row] >> (4 - column) & 1 == 1
    }
}

fn cell_index(x: f64, y: f64) -> u64 {
    (u64::from(x as i32 as u32) << 32) | u64::from(y as i32 as u32)
}
