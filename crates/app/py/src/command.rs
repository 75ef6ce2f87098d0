//! Commands of the command line, run for Python.

use crate::events::{Event, Lines, Voice};
use crate::failed::Failed;
use crate::failure_kind::FailureKind;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use weaver_cli::{Console, Interrupt, Request, Value};
use weaver_command::Failure;

/// Time between looks for Ctrl-C.
const PAUSE: Duration = Duration::from_millis(50);

/// The flags of a command: name, name of the value, None for switches, and the value where none is given.
#[pyfunction]
pub fn flags(command: &str) -> Vec<(String, Option<String>, Option<String>)> {
    let flags = weaver_command::flags(&weaver_cli::program()).into_iter().filter(|flag| flag.command == command);
    flags.map(|flag| (flag.name, flag.value, flag.default)).collect()
}

/// Runs a command line, whose first argument is the program's name, as the program of this process, and returns the
/// exit code. Signals and panics become the program's.
#[pyfunction]
pub fn run_program(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| weaver_cli::process(arguments))
}

/// Runs a command with settings by name, None for those that are not given, and returns its standard output.
///
/// `log` gets the lines of standard error, `callback` the label, done, total and note of each part that is done; an
/// answer of False stops the work as Ctrl-C does.
#[pyfunction]
pub fn run_command(
    py: Python<'_>,
    command: &str,
    settings: &Bound<'_, PyDict>,
    log: Bound<'_, PyAny>,
    callback: Option<Bound<'_, PyAny>>,
) -> PyResult<String> {
    let given = settings.iter().filter(|(_, value)| !value.is_none());
    let given = given.map(|(name, value)| Ok((name.extract()?, setting(&value)?))).collect::<PyResult<Vec<_>>>()?;
    let request = Request::of_settings(command, given).map_err(Failed::input)?;
    let work = Work::begin(request, callback.is_some())?;
    let mut listener = Listener { work: &work, log, callback, reason: None };
    loop {
        let heard = py.detach(|| lock(&work.events).recv_timeout(PAUSE));
        match heard {
            Ok(Event::Line(line)) => {
                let called = listener.log.call1((line,)).map(drop);
                listener.note(called)?;
            }
            Ok(Event::Part(part, answer)) => {
                let told = listener.told((part.label, part.done, part.total, part.note));
                let noted = listener.note(told);
                // The work goes on only now, so that it sees a requested stop at this very step.
                let _ = answer.send(());
                noted?;
            }
            Ok(Event::End(result)) => return listener.end(result),
            Err(RecvTimeoutError::Timeout) => {}
            // The thread ended without an event.
            Err(RecvTimeoutError::Disconnected) => {
                let message = "internal error in a command; please report what standard error says";
                return Err(Failed::new(FailureKind::Other, message).into());
            }
        }
        listener.note(py.check_signals())?;
    }
}

/// The value of a setting: paths and numbers as text, other iterables as a list.
fn setting(value: &Bound<'_, PyAny>) -> PyResult<Value> {
    if let Ok(flag) = value.extract::<bool>() {
        return Ok(Value::Flag(flag));
    }
    match value.try_iter() {
        Ok(values) if value.extract::<PathBuf>().is_err() => {
            Ok(Value::List(values.map(|one| text(&one?)).collect::<PyResult<_>>()?))
        }
        _ => Ok(Value::Text(text(value)?)),
    }
}

fn text(value: &Bound<'_, PyAny>) -> PyResult<OsString> {
    match value.extract::<PathBuf>() {
        Ok(path) => Ok(path.into()),
        Err(_) => value.str()?.extract(),
    }
}

/// One thread listens.
fn lock(events: &Mutex<Receiver<Event>>) -> MutexGuard<'_, Receiver<Event>> {
    events.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A command on a thread of its own.
struct Work {
    events: Mutex<Receiver<Event>>,
    interrupt: Arc<Interrupt>,
    abandoned: Arc<AtomicBool>,
}

// The caller is gone: the work ends at its next event.
impl Drop for Work {
    fn drop(&mut self) {
        self.abandoned.store(true, Ordering::Relaxed);
    }
}

impl Work {
    fn begin(request: Request, watched: bool) -> Result<Self, Failed> {
        let (sender, events) = channel();
        let (interrupt, abandoned) = (Arc::new(Interrupt::new()), Arc::new(AtomicBool::new(false)));
        let (voice, asked) = (Voice::new(sender, abandoned.clone()), interrupt.clone());
        let work = move || {
            let mut printed = Vec::new();
            let mut lines = Lines::new(voice.clone());
            let mut told = |part: &weaver_command::Part| voice.part(part);
            let mut console = Console::new(&mut printed, &mut lines, false);
            if watched {
                console.watcher = Some(&mut told);
            }
            let result = request.run(&mut console, &asked);
            let text = String::from_utf8_lossy(&printed).into_owned();
            voice.say(Event::End(result.map(|()| text)));
        };
        let thread = std::thread::Builder::new().name("splatweaver".into()).spawn(work);
        thread.map_err(|error| Failed::new(FailureKind::Other, format!("threads: {error}")))?;
        Ok(Self { events: Mutex::new(events), interrupt, abandoned })
    }
}

/// The side of Python.
struct Listener<'py, 'w> {
    work: &'w Work,
    log: Bound<'py, PyAny>,
    callback: Option<Bound<'py, PyAny>>,
    /// Reason of a requested stop: an exception, or `None` for a plain request.
    reason: Option<Option<PyErr>>,
}

impl Listener<'_, '_> {
    /// Passes a part to the callback, which may request a stop, or fail.
    fn told(&mut self, part: (&str, usize, usize, String)) -> PyResult<()> {
        let Some(callback) = self.callback.as_ref().filter(|_| self.reason.is_none()) else { return Ok(()) };
        let answer = callback.call1(part)?;
        if !answer.is_none() && !answer.is_truthy()? {
            self.stop(None)?;
        }
        Ok(())
    }

    /// Requests a stop after an exception; after a second one the work ends at once.
    fn note(&mut self, called: PyResult<()>) -> PyResult<()> {
        called.or_else(|error| self.stop(Some(error)))
    }

    fn stop(&mut self, error: Option<PyErr>) -> PyResult<()> {
        if self.work.interrupt.request() {
            self.reason = Some(error);
            return Ok(());
        }
        // The work has nothing to save, or was stopped before: it ends at once.
        weaver_cli::leave();
        let stopped = || Failed::new(FailureKind::Other, "stopped before there was anything to write").into();
        Err(error.unwrap_or_else(stopped))
    }

    fn end(self, result: Result<String, Failure>) -> PyResult<String> {
        match (result, self.reason.flatten()) {
            (_, Some(error)) => Err(error),
            (Ok(text), None) => Ok(text),
            (Err(failure), None) if failure.line().is_none() => Err(PyKeyboardInterrupt::new_err("interrupted")),
            (Err(failure), None) => Err(Failed::from(failure).into()),
        }
    }
}
