//! Settings of a small program: `cargo run --release -p weaver-run --example pendulum -- angle=2.5 method.kind=euler`.
//!
//! Swings a pendulum and prints how much of its energy the integration has made up or lost. Each argument is a setting,
//! or a file of them; the settings are printed first, as a file with its documentation that can be changed and given.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A pendulum, and how its motion is computed.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Settings {
    /// Where it is let go, in radians from its rest.
    angle: f64,
    /// Square of the frequency of small swings, per square second.
    stiffness: f64,
    /// Seconds between steps.
    step: f64,
    /// Duration of the swing, in seconds.
    duration: f64,
    /// Method of a step.
    method: Method,
}

/// Method of a step.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
enum Method {
    /// Angle and speed at once; makes energy up.
    Euler,
    /// Speed first, angle with the new speed; keeps energy over long times.
    Leapfrog {
        /// Fraction of the speed that each second takes away.
        damping: f64,
    },
}

impl Default for Settings {
    fn default() -> Self {
        let method = Method::Leapfrog { damping: 0.0 };
        Self { angle: 1.0, stiffness: 9.81, step: 0.01, duration: 20.0, method }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (sets, files): (Vec<String>, Vec<String>) = std::env::args().skip(1).partition(|a| a.contains('='));
    let s: Settings = weaver_run::settings::resolve(&Settings::default(), files.first().map(Path::new), &sets)?;
    print!("{}", weaver_run::settings::annotate(&s)?);
    let energy = |angle: f64, speed: f64| 0.5 * speed * speed + s.stiffness * (1.0 - angle.cos());
    let (mut angle, mut speed) = (s.angle, 0.0_f64);
    for _ in 0..(s.duration / s.step) as usize {
        let push = -s.stiffness * angle.sin() * s.step;
        match s.method {
            Method::Euler => (angle, speed) = (angle + speed * s.step, speed + push),
            Method::Leapfrog { damping } => {
                speed = (speed + push) * (1.0 - damping * s.step);
                angle += speed * s.step;
            }
        }
    }
    println!("\nenergy at the end: {:.1} % of the first", 100.0 * energy(angle, speed) / energy(s.angle, 0.0));
    Ok(())
}
