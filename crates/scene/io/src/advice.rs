//! Remedies for errors, which a program can say in its own terms.

use std::error::Error;

/// Remedy for an error: the last `source()` of an error that has a remedy, below any wrapper.
///
/// ```
/// use weaver_io::{Advice, check_output_file};
///
/// let refused = check_output_file(&std::env::temp_dir(), [""; 0]).unwrap_err();
/// assert_eq!(Advice::of(&refused), Some(Advice::OtherOutput));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Advice {
    /// Another place for the results.
    #[error("results can go elsewhere")]
    OtherOutput,
    /// Another folder, or resuming the run that is there.
    #[error("a run can be resumed, or begin elsewhere")]
    Resume,
    /// Nothing, as there is nothing left to do.
    #[error("nothing is left to do")]
    Complete,
    /// Another value for the setting of this name, with which the message begins.
    #[error("another value of {0} is needed")]
    Setting(&'static str),
    /// Less work at a time.
    #[error("fewer or smaller photos need less memory")]
    LessMemory {
        /// True if the Gaussians can be left out.
        gaussians: bool,
    },
    /// A smaller network.
    #[error("smaller sizes of the network need less memory")]
    SmallerNetwork,
}

impl Advice {
    /// Finds the remedy for an error among its sources.
    pub fn of(error: &(dyn Error + 'static)) -> Option<Self> {
        let mut cause = Some(error);
        while let Some(error) = cause {
            if let Some(advice) = error.downcast_ref() {
                return Some(*advice);
            }
            cause = error.source();
        }
        None
    }
}
