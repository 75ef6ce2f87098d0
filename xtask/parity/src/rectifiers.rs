//! Rectifiers flipped by the rounding of f32: the outputs of one run, unit by unit, against the outputs of a run in
//! f64.
//!
//! A rectifier has no slope at 0. A sum that rounding moves over it changes no output by more than the rounding, but
//! the gradient that passes there appears or is gone.

use serde_json::{Value, json};
use weaver_autograd::{Real, Tape};

/// Largest output of a unit that flipped by rounding, of the largest in its layer.
const ROUNDING: f64 = 1e-5;
/// Ops that may end in a rectifier.
const OPS: [&str; 4] = ["Relu", "Clamp", "linear", "conv2d"];

/// Output of one op that may end in a rectifier.
#[derive(Clone, Debug)]
pub struct Rectified {
    /// The op, and where in the model.
    at: String,
    outputs: Vec<f64>,
}

/// Outputs of the rectifiers on a tape, in order.
pub fn on<T: Real>(tape: &Tape<T>) -> Vec<Rectified> {
    let mut list = Vec::new();
    tape.for_each_node(|node| {
        if OPS.iter().any(|op| node.op.name().starts_with(op)) {
            let (of, op) = (if node.path.is_empty() { "" } else { " of " }, node.op.name());
            let at = format!("{op}{of}{}", node.path);
            list.push(Rectified { at, outputs: node.outputs[0].iter().map(|y| y.to_f64()).collect() });
        }
    });
    list
}

/// A unit that is 0 in one run and not in the other.
#[derive(Clone, Debug)]
pub struct Flip {
    at: String,
    unit: usize,
    /// The value where it is not 0.
    value: f64,
    /// The largest output of its op there.
    largest: f64,
}

impl Flip {
    /// True if rounding can have done it.
    fn is_rounding(&self) -> bool {
        self.value < ROUNDING * self.largest
    }

    pub fn json(&self) -> Value {
        json!({
            "at": self.at,
            "unit": self.unit,
            "value": self.value,
            "largest": self.largest,
            "rounding": self.is_rounding(),
        })
    }
}

/// All units that differ; `None` where the runs took different branches and cannot be compared.
pub fn flips(a: &[Rectified], b: &[Rectified]) -> Option<Vec<Flip>> {
    let mut flips = Vec::new();
    if a.len() != b.len() {
        return None;
    }
    for (a, b) in a.iter().zip(b) {
        if a.at != b.at || a.outputs.len() != b.outputs.len() {
            return None;
        }
        // A negative output is none of a rectifier.
        if a.outputs.iter().chain(&b.outputs).any(|y| *y < 0.0) {
            continue;
        }
        let pairs = a.outputs.iter().zip(&b.outputs).enumerate();
        for (unit, (x, y)) in pairs.filter(|(_, (x, y))| (**x == 0.0) != (**y == 0.0)) {
            let (value, outputs) = if *x == 0.0 { (*y, &b.outputs) } else { (*x, &a.outputs) };
            let largest = outputs.iter().copied().fold(0.0, f64::max);
            flips.push(Flip { at: a.at.clone(), unit, value, largest });
        }
    }
    Some(flips)
}

/// True if there are flips, and rounding can have done all of them.
pub fn are_rounding(flips: &[Flip]) -> bool {
    !flips.is_empty() && flips.iter().all(Flip::is_rounding)
}

/// The flip that needs the most rounding, and how many there are.
pub fn remark(flips: &[Flip]) -> Option<String> {
    let farthest = flips.iter().max_by(|a, b| (a.value / a.largest).total_cmp(&(b.value / b.largest)))?;
    let Flip { at, value, largest, .. } = farthest;
    let (count, s) = (flips.len(), if flips.len() == 1 { "" } else { "s" });
    Some(format!("{count} rectifier{s} flipped: {value:.0e} of {largest:.1} at {at}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(at: &str, outputs: &[f64]) -> Rectified {
        Rectified { at: at.into(), outputs: outputs.to_vec() }
    }

    #[test]
    fn rounding_is_told_from_a_difference() {
        let base = [run("Relu of a", &[0.0, 2.0, 1.0]), run("linear of b", &[-1.0, 0.0, 3.0])];
        let with = |outputs: &[f64]| flips(&base, &[run("Relu of a", outputs), base[1].clone()]).unwrap();
        assert!(with(&[0.0, 2.0, 1.0]).is_empty() && !are_rounding(&[]));
        let near = with(&[3e-9, 2.0, 1.0]);
        assert!(near.len() == 1 && are_rounding(&near), "{near:?}");
        assert_eq!(remark(&near).unwrap(), "1 rectifier flipped: 3e-9 of 2.0 at Relu of a");
        let far = with(&[3e-9, 2.0, 0.0]);
        assert!(far.len() == 2 && !are_rounding(&far), "{far:?}");
        assert_eq!(remark(&far).unwrap(), "2 rectifiers flipped: 1e0 of 2.0 at Relu of a");
    }

    #[test]
    fn only_rectifiers_of_the_same_network_are_compared() {
        let a = [run("linear of b", &[-1.0, 0.0, 3.0])];
        assert!(flips(&a, &[run("linear of b", &[-1.0, 1e-9, 3.0])]).unwrap().is_empty());
        assert!(flips(&a, &[]).is_none());
        assert!(flips(&a, &[run("linear of c", &[-1.0, 0.0, 3.0])]).is_none());
        assert!(flips(&a, &[run("linear of b", &[-1.0, 0.0])]).is_none());
    }

    #[test]
    fn rectifiers_are_found_on_a_tape() {
        let tape = Tape::<f32>::new();
        let x = tape.leaf(&[-1.0, 2.0], [2]);
        tape.part("layer", || (x * 3.0).relu());
        let found = on(&tape);
        assert_eq!(found.len(), 1);
        assert_eq!((found[0].at.as_str(), &found[0].outputs[..]), ("Relu of layer", &[0.0, 6.0][..]));
    }
}
