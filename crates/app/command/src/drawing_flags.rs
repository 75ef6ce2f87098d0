//! How a file of Gaussians is drawn.

use crate::drawing::DrawingOptions;
use crate::flags::{fraction, positive};
use clap::Args;

/// Options of drawing a scene. A fit writes them to summary.json beside its scene.
#[derive(Args, Clone, Copy, Debug)]
#[command(next_help_heading = "Drawing")]
pub struct DrawingFlags {
    /// Color where nothing is: white, black or R,G,B from 0 to 1 [default: what summary.json beside the scene says, or
    /// white]
    #[arg(long, value_name = "COLOR", value_parser = background)]
    pub background: Option<Rgb>,
    /// Opacities are lowered where a Gaussian is widened to a pixel; =false if not [default: what summary.json says, or
    /// false]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    pub antialiased: Option<bool>,
    /// Gaussians nearer to a camera than this are not drawn, world units [default: what summary.json says, or 0.01]
    #[arg(long, value_name = "DISTANCE", value_parser = positive())]
    pub near: Option<f64>,
    /// Largest opacity of a single Gaussian at a pixel, above 0 and below 1 [default: what summary.json says, or 0.99]
    #[arg(long, value_name = "ALPHA", value_parser = fraction())]
    pub alpha_max: Option<f64>,
}

impl From<DrawingFlags> for DrawingOptions {
    fn from(flags: DrawingFlags) -> Self {
        let DrawingFlags { background, antialiased, near, alpha_max } = flags;
        Self { background: background.map(|color| color.0), antialiased, near, alpha_max }
    }
}

/// A color; a type of its own, for the command line takes lists apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rgb(pub [f32; 3]);

/// A color by its name or by three numbers.
pub fn background(text: &str) -> Result<Rgb, String> {
    match text {
        "white" => Ok(Rgb([1.0; 3])),
        "black" => Ok(Rgb([0.0; 3])),
        numbers => color(numbers).map(Rgb).map_err(|e| format!("{e}, or white or black")),
    }
}

fn color(text: &str) -> Result<[f32; 3], String> {
    let numbers: Result<Vec<f32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    let color = numbers.ok().and_then(|n| <[f32; 3]>::try_from(n).ok());
    color
        .filter(|c| c.iter().all(|x| (0.0..=1.0).contains(x)))
        .ok_or_else(|| "expected three numbers from 0 to 1, as in 1,1,1".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn backgrounds_have_names_or_numbers() {
        assert_eq!(background("black"), Ok(Rgb([0.0; 3])));
        assert_eq!(background("0,0.5,1"), Ok(Rgb([0.0, 0.5, 1.0])));
        assert!(background("gray").is_err() && background("2,0,0").is_err());
    }

    #[test]
    fn colors_are_three_numbers_from_0_to_1() {
        assert_eq!(color("0, 0.5,1"), Ok([0.0, 0.5, 1.0]));
        for wrong in ["1,1", "1,1,1,1", "a,b,c", "0,0,256", "NaN,0,0", ""] {
            assert!(color(wrong).is_err(), "{wrong}");
        }
    }
}
