//! The walk-through docs/contribute/add-an-op.md is a doctest of this package; this test holds it to its promise.

#[test]
fn an_op_takes_30_lines() {
    let page = include_str!("../../docs/contribute/add-an-op.md");
    let code = page.split("```").nth(1).expect("the first block of code");
    let (op, test) = code.split_once("// A few more lines test").expect("the op, then its test");
    let (test, _) = test.split_once("// Shapes that do not fit").expect("the test, then a mistake");
    let lines = |text: &str| text.lines().filter(|line| !line.trim().is_empty()).count();
    assert!(lines(op) <= 30 && lines(test) <= 10, "{} and {} lines", lines(op), lines(test));
}
