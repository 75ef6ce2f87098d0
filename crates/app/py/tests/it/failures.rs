//! Kinds of failures.

use crate::failure_kind::FailureKind;
use weaver_command::Failure;

#[test]
fn failures_have_the_kind_of_their_innermost_error() {
    let missing = weaver_io::read_text("nothing/here").unwrap_err();
    let diverged = weaver_fit::FitError::Diverged { step: 1, photo: "a".into(), loss: f64::NAN };
    let little = weaver_io::TooLittleMemory { needed: 2, available: 1, advice: String::new() };
    let complete = weaver_run::Error::complete("a");
    for (failure, kind) in [
        (Failure::Usage("x".into()), FailureKind::Input),
        (Failure::message("x"), FailureKind::Other),
        (weaver_reconstruct::Error::File(missing).into(), FailureKind::File),
        (weaver_reconstruct::Error::Fit(diverged).into(), FailureKind::Numeric),
        (weaver_reconstruct::Error::Run(complete).into(), FailureKind::Input),
        (little.into(), FailureKind::Memory),
    ] {
        assert_eq!(FailureKind::of(&failure), kind, "{failure:?}");
    }
}
