//! Checks of settings: the key that is wrong, the expected and the found value.

use super::{BackboneConfig, CameraConfig, GaussianConfig, ModelConfig, ParametrizationConfig, RasterConfig};
use std::fmt::Display;
use weaver_kernels::nearest_neighbors::MAX_NEIGHBORS;

/// No size of a network is larger: products of two of them do not overflow.
pub const MAX_SIZE: usize = 1_000_000;

/// Checks a setting.
///
/// # Errors
/// The key that is wrong, the expected and the found value, where it does not hold.
pub fn ensure(holds: bool, key: &str, expected: impl Display, found: impl Display) -> Result<(), String> {
    if holds { Ok(()) } else { Err(format!("model.{key}: expected {expected}, found {found}")) }
}

/// Checks that a number is above 0 and finite.
///
/// # Errors
/// As [`ensure`].
pub fn positive(key: &str, value: f64) -> Result<(), String> {
    ensure(value > 0.0 && value.is_finite(), key, "a positive number", value)
}

/// Checks that a number is at least 0 and finite.
///
/// # Errors
/// As [`ensure`].
pub fn not_negative(key: &str, value: f64) -> Result<(), String> {
    ensure(value >= 0.0 && value.is_finite(), key, "a number that is not negative", value)
}

/// Checks that a number is a positive multiple of another.
///
/// # Errors
/// As [`ensure`].
pub fn multiple(key: &str, value: usize, of: usize) -> Result<(), String> {
    ensure(value > 0 && value.is_multiple_of(of), key, format_args!("a positive multiple of {of}"), value)
}

/// Checks backbone and camera head, whose keys begin with `at`, for images in patches.
///
/// # Errors
/// As [`ensure`].
pub fn cameras(at: &str, (b, c): (&BackboneConfig, &CameraConfig), patch: [(&str, usize); 3]) -> Result<(), String> {
    let key = |name: &str| format!("{at}{name}");
    let [rows, columns] = b.position_table.unwrap_or([1; 2]);
    let at_least_one = [
        ("backbone.dim", b.dim),
        ("backbone.encoder_heads", b.encoder_heads),
        ("backbone.heads", b.heads),
        ("backbone.rounds", b.rounds),
        ("backbone.position_table", rows),
        ("backbone.position_table", columns),
        ("camera.heads", c.heads),
        ("camera.iterations", c.iterations),
    ];
    for (name, value) in at_least_one {
        ensure((1..=MAX_SIZE).contains(&value), &key(name), format_args!("1 to {MAX_SIZE}"), value)?;
    }
    for (name, value) in
        [("backbone.encoder_depth", b.encoder_depth), ("backbone.registers", b.registers), ("camera.depth", c.depth)]
    {
        ensure(value <= MAX_SIZE, &key(name), format_args!("0 to {MAX_SIZE}"), value)?;
    }
    let [patch, sides @ ..] = patch;
    for (name, side) in [patch].iter().chain(&sides) {
        ensure((1..=MAX_SIZE).contains(side), name, format_args!("1 to {MAX_SIZE}"), side)?;
    }
    sides.into_iter().try_for_each(|(name, side)| multiple(name, side, patch.1))?;
    multiple(&key("backbone.dim"), b.dim, b.encoder_heads)?;
    multiple(&key("backbone.dim"), b.dim, 4 * b.heads)?;
    let expected = format_args!("a divisor of twice backbone.dim, {}", 2 * b.dim);
    ensure((2 * b.dim).is_multiple_of(c.heads), &key("camera.heads"), expected, c.heads)?;
    not_negative(&key("backbone.layer_scale"), b.layer_scale)?;
    not_negative(&key("backbone.weight_std"), b.weight_std)?;
    not_negative(&key("backbone.position_std"), b.position_std)?;
    not_negative(&key("backbone.token_std"), b.token_std)?;
    not_negative(&key("camera.layer_scale"), c.layer_scale)?;
    if let Some(fov) = c.base_fov {
        let inside = fov > 0.0 && fov < std::f64::consts::PI;
        ensure(inside, &key("camera.base_fov"), "radians between 0 and pi", fov)?;
    }
    ensure((0.0..=1.0).contains(&c.tangent_offset), &key("camera.tangent_offset"), "0 to 1", c.tangent_offset)
}

impl RasterConfig {
    /// Checks all numbers.
    ///
    /// # Errors
    /// As [`ensure`].
    pub fn check(&self) -> Result<(), String> {
        positive("raster.near", self.near)?;
        let alpha = self.alpha_max;
        ensure(alpha > 0.0 && alpha < 1.0, "raster.alpha_max", "a number between 0 and 1", alpha)?;
        for color in self.background {
            ensure((0.0..=1.0).contains(&color), "raster.background", "colors of 0 to 1", color)?;
        }
        Ok(())
    }
}

impl ModelConfig {
    /// Checks that every setting is in its range and that the sizes fit together.
    ///
    /// # Errors
    /// The first setting that is wrong: its key, the expected and the found value.
    pub fn check(&self) -> Result<(), String> {
        let sides = [("patch", self.patch), ("width", self.width), ("height", self.height)];
        cameras("", (&self.backbone, &self.camera), sides)?;
        self.check_sizes()?;
        self.check_multiples()?;
        self.check_numbers()
    }

    fn check_sizes(&self) -> Result<(), String> {
        let (b, d) = (&self.backbone, &self.dense);
        let s = d.stereo.unwrap_or_default();
        let at_least_one = [
            ("dense.features", d.features),
            ("dense.channels", d.channels),
            ("dense.depth_hidden", d.depth_hidden),
            ("dense.image_skip_hidden", d.image_skip_hidden),
            ("dense.guidance_hidden", d.guidance_hidden),
            ("dense.stereo.channels", s.channels),
            ("dense.stereo.hidden", s.hidden),
            ("dense.stereo.depths", s.depths),
        ];
        for (key, value) in at_least_one.into_iter().chain(d.out_channels.map(|n| ("dense.out_channels", n))) {
            ensure((1..=MAX_SIZE).contains(&value), key, format_args!("1 to {MAX_SIZE}"), value)?;
        }
        let depth_features = d.depth_features.unwrap_or(0);
        ensure(depth_features <= MAX_SIZE, "dense.depth_features", format_args!("0 to {MAX_SIZE}"), depth_features)?;
        for layer in d.layers {
            ensure(layer < b.rounds, "dense.layers", format_args!("rounds below {}", b.rounds), layer)?;
        }
        Ok(())
    }

    fn check_multiples(&self) -> Result<(), String> {
        let d = &self.dense;
        multiple("dense.channels", d.channels, 4)?;
        d.depth_features.map_or(Ok(()), |n| multiple("dense.depth_features", n, 8))?;
        d.out_channels.into_iter().try_for_each(|n| multiple("dense.out_channels", n, 4))
    }

    fn check_numbers(&self) -> Result<(), String> {
        self.dense.log_depth_limit.map_or(Ok(()), |limit| positive("dense.log_depth_limit", limit))?;
        if let Some(stereo) = self.dense.stereo {
            ensure(stereo.depths >= 2, "dense.stereo.depths", "at least 2", stereo.depths)?;
            ensure(
                stereo.reach > 1.0 && stereo.reach.is_finite(),
                "dense.stereo.reach",
                "a factor above 1",
                stereo.reach,
            )?;
        }
        self.gaussians.check()?;
        self.raster.check()
    }
}

impl GaussianConfig {
    /// Checks that every setting is in its range.
    ///
    /// # Errors
    /// As [`ensure`].
    pub fn check(&self) -> Result<(), String> {
        let at_least_one = [
            ("gaussians.router_hidden", self.router_hidden),
            ("gaussians.projector", self.projector),
            ("gaussians.predictor", self.predictor),
        ];
        for (key, value) in at_least_one {
            ensure((1..=MAX_SIZE).contains(&value), key, format_args!("1 to {MAX_SIZE}"), value)?;
        }
        for (key, value, most) in
            [("gaussians.sh_degree", self.sh_degree, 4), ("gaussians.neighbors", self.neighbors, MAX_NEIGHBORS)]
        {
            ensure(value <= most, key, format_args!("0 to {most}"), value)?;
        }
        // Assignments hold the number of a pixel's Gaussians as a byte.
        ensure((1..=255).contains(&self.max_per_pixel), "gaussians.max_per_pixel", "1 to 255", self.max_per_pixel)?;
        positive("gaussians.temperature", self.temperature)?;
        not_negative("gaussians.expert_gain", self.expert_gain)?;
        let parametrization = |key: &str| format!("gaussians.parametrization.{key}");
        match self.parametrization {
            ParametrizationConfig::Published { offset_reach, scale_multiplier, scale_max } => {
                not_negative(&parametrization("offset_reach"), offset_reach)?;
                positive(&parametrization("scale_multiplier"), scale_multiplier)?;
                positive(&parametrization("scale_max"), scale_max)
            }
            ParametrizationConfig::Footprint { offset_reach, scale }
            | ParametrizationConfig::Patch { offset_reach, scale } => {
                not_negative(&parametrization("offset_reach"), offset_reach)?;
                positive(&parametrization("scale"), scale)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::{ModelConfig, PRESETS, ParametrizationConfig};

    #[test]
    fn presets_are_valid() {
        for name in PRESETS {
            let config = ModelConfig::preset(name).expect("listed presets exist");
            assert_eq!(config.check(), Ok(()), "{name}");
        }
    }

    /// Every number that is set to something out of its range is named with the range and the found value.
    #[test]
    fn each_key_has_a_range() {
        type Change = fn(&mut ModelConfig);
        let cases: [(Change, &str); 17] = [
            (|c| c.camera.tangent_offset = -1e-3, "model.camera.tangent_offset: expected 0 to 1, found -0.001"),
            (|c| c.width = 63, "model.width: expected a positive multiple of 8, found 63"),
            (|c| c.patch = 0, "model.patch: expected 1 to 1000000, found 0"),
            (|c| c.backbone.dim = usize::MAX, "model.backbone.dim: expected 1 to 1000000, found 18446744073709551615"),
            (
                |c| c.backbone.position_table = Some([0, 3]),
                "model.backbone.position_table: expected 1 to 1000000, found 0",
            ),
            (
                |c| c.backbone.token_std = -1.0,
                "model.backbone.token_std: expected a number that is not negative, found -1",
            ),
            (|c| c.camera.heads = 5, "model.camera.heads: expected a divisor of twice backbone.dim, 192, found 5"),
            (|c| c.camera.base_fov = Some(4.0), "model.camera.base_fov: expected radians between 0 and pi, found 4"),
            (|c| c.dense.layers[2] = 9, "model.dense.layers: expected rounds below 4, found 9"),
            (|c| c.dense.out_channels[3] = 6, "model.dense.out_channels: expected a positive multiple of 4, found 6"),
            (
                |c| c.dense.depth_features = Some(0),
                "model.dense.depth_features: expected a positive multiple of 8, found 0",
            ),
            (
                |c| c.dense.log_depth_limit = Some(f64::NAN),
                "model.dense.log_depth_limit: expected a positive number, found NaN",
            ),
            (|c| c.gaussians.max_per_pixel = 256, "model.gaussians.max_per_pixel: expected 1 to 255, found 256"),
            (|c| c.gaussians.sh_degree = 5, "model.gaussians.sh_degree: expected 0 to 4, found 5"),
            (
                |c| c.gaussians.parametrization = ParametrizationConfig::Footprint { offset_reach: 2.0, scale: 0.0 },
                "model.gaussians.parametrization.scale: expected a positive number, found 0",
            ),
            (|c| c.raster.alpha_max = 1.0, "model.raster.alpha_max: expected a number between 0 and 1, found 1"),
            (|c| c.raster.background[1] = 2.0, "model.raster.background: expected colors of 0 to 1, found 2"),
        ];
        for (change, message) in cases {
            let mut config = ModelConfig::preset("tiny").expect("there is a preset called tiny");
            change(&mut config);
            assert_eq!(config.check().unwrap_err(), message);
        }
    }

    #[test]
    fn a_file_survives_and_names_what_it_does_not_know() {
        for name in PRESETS {
            let config = ModelConfig::preset(name).expect("listed presets exist");
            let text = serde_json::to_string(&config).unwrap();
            assert_eq!(serde_json::from_str::<ModelConfig>(&text).unwrap(), config);
        }
        let text = serde_json::to_string(&ModelConfig::preset("tiny").expect("a preset")).unwrap();
        assert!(text.contains(r#""parametrization":{"kind":"footprint","offset_reach":2.0,"scale":0.7}"#), "{text}");
        let other = text.replace(r#""kind":"footprint""#, r#""kind":"published""#);
        let error = serde_json::from_str::<ModelConfig>(&other).unwrap_err().to_string();
        assert!(error.contains("unknown field `scale`"), "{error}");
    }
}
