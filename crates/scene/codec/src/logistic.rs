//! The logistic function and its inverse as tables, the same bits on every machine.
//!
//! A decoder must find the probabilities of the encoder to the bit.

use crate::exact::exp;
use std::sync::LazyLock;

/// Steps of the tables' argument in a unit, and the largest argument: 1 / (1 + e^11) is about 2^-16.
const STEPS: f32 = 64.0;
const LARGEST: f32 = 11.0;

/// Probabilities that [`stretch`] tells apart.
const LEVELS: usize = 1 << 12;

/// Room for all steps, a power of two, so that no index has to be checked.
const ROOM: usize = 1 << 11;

static SQUASH: LazyLock<[f32; ROOM]> =
    LazyLock::new(|| std::array::from_fn(|i| logistic(i as f64 / f64::from(STEPS) - f64::from(LARGEST)) as f32));

static STRETCH: LazyLock<[f32; LEVELS]> = LazyLock::new(|| std::array::from_fn(|i| logit(i) as f32));

fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + exp(-x))
}

/// The argument at which the logistic function is in the middle of a level, by bisection.
fn logit(level: usize) -> f64 {
    let p = (level as f64 + 0.5) / LEVELS as f64;
    let halve = |(low, high): (f64, f64), _| {
        let middle = 0.5 * (low + high);
        if logistic(middle) < p { (middle, high) } else { (low, middle) }
    };
    (0..40).fold((-16.0, 16.0), halve).0
}

/// Both tables, looked up once for a stream.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Logistic {
    squash: &'static [f32; ROOM],
    stretch: &'static [f32; LEVELS],
}

impl Default for Logistic {
    fn default() -> Self {
        Self { squash: &SQUASH, stretch: &STRETCH }
    }
}

impl Logistic {
    /// `1 / (1 + exp(-x))`, for arguments beyond 11 that of 11.
    #[inline(always)]
    pub(crate) fn squash(self, x: f32) -> f32 {
        let place = (x.clamp(-LARGEST, LARGEST) + LARGEST) * STEPS;
        let below = place as usize;
        let (low, high) = (self.squash[below % ROOM], self.squash[(below + 1) % ROOM]);
        low + (high - low) * (place - below as f32)
    }

    /// `ln(p / (1 - p))` for a probability in parts of 2^16.
    #[inline(always)]
    pub(crate) fn stretch(self, p: u16) -> f32 {
        self.stretch[usize::from(p >> 4)]
    }
}
