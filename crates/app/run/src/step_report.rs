//! Reports of steps.

use std::borrow::Cow;

/// Report of one step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepReport {
    /// Steps done, this one included, over all stages.
    pub step: usize,
    /// Steps of the whole run.
    pub of: usize,
    /// Name of the stage; empty where there is only one.
    pub stage: String,
    /// The loss.
    pub loss: f64,
    /// Further numbers.
    pub scalars: Vec<Scalar>,
}

/// A number of a step, by the name that logs, TensorBoard and curves have it by.
#[derive(Clone, Debug, PartialEq)]
pub struct Scalar {
    /// The name; the part before a slash groups charts.
    pub name: Cow<'static, str>,
    /// The number.
    pub value: f64,
    /// True if a record of several steps has its mean, as of a loss, or its last value, as of a rate or a count.
    pub averaged: bool,
}

impl StepReport {
    /// The number of this name.
    pub fn scalar(&self, name: &str) -> Option<f64> {
        self.scalars.iter().find(|scalar| scalar.name == name).map(|scalar| scalar.value)
    }

    /// The numbers whose names begin with `name` and a slash, by the rest of their names.
    pub fn group<'a>(&'a self, name: &'a str) -> impl Iterator<Item = (&'a str, f64)> {
        let within =
            move |scalar: &'a Scalar| scalar.name.strip_prefix(name)?.strip_prefix('/').map(|n| (n, scalar.value));
        self.scalars.iter().filter_map(within)
    }
}

impl Scalar {
    /// A number whose mean is recorded over several steps.
    pub fn mean(name: impl Into<Cow<'static, str>>, value: f64) -> Self {
        Self { name: name.into(), value, averaged: true }
    }

    /// A number whose last value is recorded of several steps.
    pub fn last(name: impl Into<Cow<'static, str>>, value: f64) -> Self {
        Self { name: name.into(), value, averaged: false }
    }
}
