//! Errors of libraries that are best explained in terms of flags.

use std::error::Error;
use weaver_command::Failure;

/// The exit code and the message of a failure that is best explained in terms of flags.
pub fn explained(failure: &Failure) -> Option<(u8, String)> {
    match failure {
        Failure::Error(error) => in_flags(error.as_ref()),
        Failure::Usage(_) | Failure::OutputClosed => None,
    }
}

fn in_flags(error: &(dyn Error + 'static)) -> Option<(u8, String)> {
    use weaver_inference::Error as Inference;
    use weaver_run::Error as Run;
    use weaver_trainer::Error as Training;
    let training = error.downcast_ref::<Training>();
    match run_error(error) {
        Some(Run::RunExists { .. }) => {
            return Some((2, format!("{error}; give another --out, or go on with it by --resume")));
        }
        Some(Run::Complete { .. }) => return Some((2, error.to_string())),
        _ => {}
    }
    if let Some(output) = refused_output(error) {
        return Some((2, format!("{output}; give another --out")));
    }
    if let Some(weaver_dynamic_run::RunError::Setting { .. }) = error.downcast_ref() {
        return Some((2, format!("--{error}")));
    }
    let inference = match training {
        Some(Training::Inference(error)) => Some(error),
        _ => error.downcast_ref::<Inference>(),
    };
    match inference? {
        Inference::NoBudget { .. } => Some((2, format!("--{error}"))),
        Inference::ImageSize { patch, side } => {
            Some((2, format!("--size: expected multiples of {patch}, found {side}")))
        }
        Inference::Memory { gaussians, .. } => {
            let third =
                if *gaussians { "--geometry (cameras, depth and points only)" } else { "closing other programs" };
            Some((1, format!("{error}; fewer photos, a smaller --size or {third} reduces it")))
        }
        _ => None,
    }
}

/// The error of a run's folder, if an error is one.
fn run_error<'a>(error: &'a (dyn Error + 'static)) -> Option<&'a weaver_run::Error> {
    use weaver_dynamic_run::RunError as Dynamic;
    use weaver_fit_run::RunError as Fit;
    use weaver_trainer::Error as Training;
    if let Some(Training::Run(error)) = error.downcast_ref() {
        Some(error)
    } else if let Some(Fit::Run(error)) = error.downcast_ref() {
        Some(error)
    } else if let Some(Dynamic::Run(error)) = error.downcast_ref() {
        Some(error)
    } else {
        error.downcast_ref()
    }
}

/// The refusal to write where something would be lost, if an error is one.
fn refused_output<'a>(error: &'a (dyn Error + 'static)) -> Option<&'a weaver_io::Error> {
    use weaver_data::Error as Data;
    use weaver_dynamic_run::RunError as Dynamic;
    use weaver_fit_run::RunError as Fit;
    use weaver_inference::Error as Inference;
    use weaver_trainer::Error as Training;
    let file = if let Some(error) = error.downcast_ref() {
        error
    } else if let Some(weaver_run::Error::File(error)) = run_error(error) {
        error
    } else if let Some(Fit::File(error)) = error.downcast_ref() {
        error
    } else if let Some(Dynamic::File(error)) = error.downcast_ref() {
        error
    } else if let Some(Training::Io(error) | Training::Inference(Inference::Io(error))) = error.downcast_ref() {
        error
    } else if let Some(Inference::Io(error)) = error.downcast_ref() {
        error
    } else if let Some(Data::Format(error)) = error.downcast_ref() {
        error
    } else {
        return None;
    };
    matches!(file, weaver_io::Error::Output { .. }).then_some(file)
}
