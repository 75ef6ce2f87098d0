//! The ends of a run that goes on for as long as held-out photos gain.

use serde::{Deserialize, Serialize};

/// The scene at an end of the run that may turn out to have been the best one.
pub(crate) const BEFORE: &str = "before.safetensors";
/// Passes through the photos before the first end, and the least steps of them.
const PASSES: usize = 20;
const LEAST: usize = 1500;
/// Gain of twice the steps that is worth it, dB.
const WORTH: f64 = 0.1;

/// The course of a run that goes on for as long as held-out photos gain: each time it comes to its end they are judged,
/// and it [goes on](weaver_fit::Fit::prolong) to twice the steps, with up to twice the Gaussians.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Gaining {
    /// Decibels that twice the steps have to gain for the run to go on.
    pub worth: f64,
    /// The most Gaussians at any time; `None` leaves it to memory.
    pub most_gaussians: Option<usize>,
    /// The ends so far.
    pub ends: Vec<End>,
}

/// An end of a run, which went on or not.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct End {
    /// Steps of the run.
    pub steps: usize,
    /// Gaussians that there might be.
    pub gaussians: usize,
    /// Mean PSNR of the held-out photos, dB.
    pub psnr: f64,
}

impl Default for Gaining {
    fn default() -> Self {
        Self { worth: WORTH, most_gaussians: None, ends: Vec::new() }
    }
}

impl Gaining {
    /// Steps to the first end, of a run with so many photos.
    pub(crate) fn first_steps(photos: usize) -> usize {
        (PASSES * photos).max(LEAST)
    }

    /// Decibels of the last end over the one before.
    pub(crate) fn gain(&self) -> f64 {
        match self.ends.as_slice() {
            [.., before, last] => last.psnr - before.psnr,
            _ => f64::INFINITY,
        }
    }
}
