use super::{Settings, defaults};
use weaver_run::settings::{annotate, parse, resolve};

#[test]
fn every_key_stands_below_its_documentation() {
    let expected = "\
# Seed of the random numbers.
seed = 0
# Learning rate. Range: more than 0.
rate = 0.5
# Where results go.
folder = \"runs/a\"
# Color behind the scene. Range: 0 to 1.
background = [1.0, 1.0, 1.0]
# Which cameras are used. One of: given: Those of the data; found: Those that are found.
cameras = \"given\"
# Seconds after which to stop. Range: at least 0.
# limit =

# Strategy of adding Gaussians. One of: split: Where the gradient is large; relocate: By moving dead ones.
[strategy]
kind = \"split\"
# Steps between looks.
every = 100
# From which gradient on. Range: 0 to less than 1.
threshold = 0.0002

# A part of a run.
[[stages]]
# Its name in logs.
name = \"coarse\"
# Optimizer steps. Range: 1 to 1000.
steps = 10
";
    let text = annotate(&defaults()).unwrap();
    assert!(text.starts_with(expected), "{text}");
}

#[test]
fn what_is_printed_is_read_back() {
    let words = ["folder=two\nlines = [x]\n[more]", "limit=3", "strategy.kind=relocate", "stages.1.name=a = b"];
    let s = resolve(&defaults(), None, &words.map(String::from)).unwrap();
    let text = annotate(&s).unwrap();
    assert_eq!(parse::<Settings>(&text, "text").unwrap(), s, "{text}");
}
