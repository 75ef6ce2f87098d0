//! Detail of many scales on surfaces, left out where pixels cannot show it.

use super::Draws;
use crate::color::color;
use weaver_geometry::glam::{Vec2, Vec3};

/// Layers of detail, and by how much each is finer and fainter than the one before.
const LAYERS: u32 = 13;
const FINER: f32 = 0.55;
const FAINTER: f32 = 0.8;

/// Texture of a surface: noise of many scales between two colors.
#[derive(Clone, Copy, Debug)]
pub(super) struct Paint {
    pub seed: u32,
    pub colors: [Vec3; 2],
    /// Scene units over which the coarsest layer changes.
    pub coarsest: f32,
    pub contrast: f32,
}

impl Paint {
    /// Any hue, between a dark and a light value.
    fn any(draws: &mut Draws, saturation: f64, values: [f64; 2], coarsest: f32, contrast: f32) -> Self {
        let hue = draws.within(0.0, 1.0);
        let colors = values.map(|value| color(hue, saturation, value).as_vec3());
        Self { seed: seed(draws), colors, coarsest, contrast }
    }

    /// Walls and the ground.
    pub fn plaster(draws: &mut Draws) -> Self {
        Self::any(draws, 0.25, [0.25, 0.95], 1.5, 0.55)
    }

    /// Frames, sills and balconies.
    pub fn trim(draws: &mut Draws) -> Self {
        Self::any(draws, 0.15, [0.35, 1.0], 0.6, 0.4)
    }

    /// Glass.
    pub fn pane(draws: &mut Draws) -> Self {
        Self::any(draws, 0.3, [0.05, 0.5], 0.8, 0.4)
    }

    /// A texture unlike any other: two colors, much contrast.
    pub fn poster(draws: &mut Draws) -> Self {
        let mut any = |low, high| color(draws.within(0.0, 1.0), draws.within(0.2, 0.8), draws.within(low, high));
        let colors = [any(0.0, 0.4).as_vec3(), any(0.7, 1.0).as_vec3()];
        Self { seed: seed(draws), colors, coarsest: 0.4, contrast: 0.9 }
    }

    /// The color at a place of a face, without the detail that is finer than a pixel's footprint; both in scene units.
    pub fn color(&self, uv: Vec2, face: u32, footprint: f32) -> Vec3 {
        let (mut sum, mut length, mut strength) = (0.0, self.coarsest, self.contrast);
        for layer in 0..LAYERS {
            // Whole from three pixels on, gone below one and a half.
            let kept = (length / (1.5 * footprint) - 1.0).min(1.0);
            if kept <= 0.0 {
                break;
            }
            sum += kept * strength * (noise(uv / length, self.seed ^ (face << 8 | layer)) - 0.5);
            length *= FINER;
            strength *= FAINTER;
        }
        self.colors[0].lerp(self.colors[1], (0.5 + sum).clamp(0.0, 1.0))
    }
}

/// A seed whose lowest bits are left to faces and layers.
fn seed(draws: &mut Draws) -> u32 {
    (draws.below(1 << 20) as u32) << 12
}

/// Values at whole numbers, and smooth between them.
fn noise(p: Vec2, seed: u32) -> f32 {
    let base = p.floor();
    let f = p - base;
    let f = f * f * (3.0 - 2.0 * f);
    let [x, y] = [base.x as i32 as u32, base.y as i32 as u32];
    let row = |y: u32| {
        let [a, b] = [x, x.wrapping_add(1)].map(|x| hash(x, y, seed));
        a + (b - a) * f.x
    };
    let [a, b] = [row(y), row(y.wrapping_add(1))];
    a + (b - a) * f.y
}

/// A number from 0 to 1 for three others: rounds of multiplication and shift.
pub(super) fn hash(x: u32, y: u32, seed: u32) -> f32 {
    let mixed = x.wrapping_mul(0x9E37_79B1) ^ y.wrapping_mul(0x85EB_CA77) ^ seed.wrapping_mul(0xC2B2_AE3D);
    let mixed = (mixed ^ mixed >> 15).wrapping_mul(0x2C1B_3C6D);
    let mixed = (mixed ^ mixed >> 13).wrapping_mul(0x297A_2D39);
    ((mixed ^ mixed >> 16) >> 8) as f32 / (1 << 24) as f32
}
