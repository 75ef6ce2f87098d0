//! An installed program, as a process of its own that ends no later than this one.

use crate::Error;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::Duration;

/// Installation of ffmpeg.
pub const INSTALL: &str = if cfg!(target_os = "macos") {
    "to install it: brew install ffmpeg"
} else if cfg!(windows) {
    "to install it: winget install ffmpeg"
} else {
    "to install it: sudo apt install ffmpeg, or sudo dnf install ffmpeg"
};
/// Bytes that are kept of complaints: a damaged file may have one for each frame.
const MOST: usize = 4096;
/// Bytes of a line of messages, at most; the rest of a longer one is another line.
const LONGEST: u64 = 1 << 16;
/// Messages that are quoted.
const QUOTED: usize = 4;
/// Characters of each that are.
const LINE: usize = 200;
/// Time between looks at whether it has ended.
const PAUSE: Duration = Duration::from_millis(2);

/// All that were started and may still run.
static RUNNING: Mutex<Vec<Weak<Mutex<Child>>>> = Mutex::new(Vec::new());

/// Is given each line of a program's messages, and returns the complaint in it, if it is one.
pub type Listener = Box<dyn FnMut(&str) -> Option<String> + Send>;

/// A program that runs; killed when this is dropped.
#[derive(Debug)]
pub struct Program {
    name: String,
    process: Arc<Mutex<Child>>,
    /// Its messages, read as they arrive, since a full pipe would block it.
    complaints: Option<JoinHandle<String>>,
}

/// Words in which programs pass on the system's errors, and their kinds: where the machine is at fault, another one
/// may do better.
const PASSING: [(&str, ErrorKind); 3] = [
    ("No space left on device", ErrorKind::StorageFull),
    ("Disk quota exceeded", ErrorKind::QuotaExceeded),
    ("Cannot allocate memory", ErrorKind::OutOfMemory),
];

/// End of a program.
#[derive(Debug)]
pub struct Ended {
    name: String,
    status: ExitStatus,
    complaints: String,
}

impl Program {
    /// Starts a program all of whose messages are complaints; `missing` is said where there is none on the PATH.
    pub fn start(command: Command, missing: &str) -> Result<Self, Error> {
        Self::find(command)?.ok_or_else(|| Error::input(missing))
    }

    /// Starts a program; `None` where there is none on the PATH.
    pub fn find(command: Command) -> Result<Option<Self>, Error> {
        Self::listen(command, Box::new(|line| Some(line.into())))
    }

    /// Starts a program whose messages are listened to; `None` where there is none on the PATH.
    pub fn listen(mut command: Command, listener: Listener) -> Result<Option<Self>, Error> {
        let name = command.get_program().to_string_lossy().into_owned();
        // Locked before it starts, so that a Ctrl-C just then ends it, too.
        let mut running = locked(&RUNNING);
        let mut process = match command.stderr(Stdio::piped()).spawn() {
            Ok(process) => process,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(Error::input(format!("{name}: {error}"))),
        };
        let complaints = process.stderr.take().map(|pipe| std::thread::spawn(move || complaints(pipe, listener)));
        let process = Arc::new(Mutex::new(process));
        running.retain(|process| process.strong_count() > 0);
        running.push(Arc::downgrade(&process));
        drop(running);
        Ok(Some(Self { name, process, complaints }))
    }

    /// The pipe that it reads, if it was asked for and not taken before.
    pub fn stdin(&self) -> Option<ChildStdin> {
        locked(&self.process).stdin.take()
    }

    /// The pipe that it writes, likewise.
    pub fn stdout(&self) -> Option<ChildStdout> {
        locked(&self.process).stdout.take()
    }

    /// Waits until it has ended by itself, which it does when its pipes are closed or read to the end.
    pub fn end(&mut self) -> Result<Ended, Error> {
        // It is not locked while it is waited for, so that it can be killed meanwhile.
        let status = loop {
            let status = locked(&self.process).try_wait();
            match status.map_err(|error| Error::input(format!("{}: {error}", self.name)))? {
                Some(status) => break status,
                None => std::thread::sleep(PAUSE),
            }
        };
        let complaints = self.complaints.take().and_then(|reader| reader.join().ok()).unwrap_or_default();
        Ok(Ended { name: self.name.clone(), status, complaints })
    }

    /// Ends it at once.
    pub fn kill(&self) {
        // Of one that has ended there is nothing to stop, and both calls fail harmlessly.
        let mut process = locked(&self.process);
        let _ = process.kill();
        let _ = process.wait();
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        self.kill();
    }
}

impl Ended {
    /// Its messages in a line, if there were any.
    pub fn complaints(&self) -> Option<String> {
        let lines = self.complaints.lines().map(str::trim).filter(|line| !line.is_empty());
        let lines: Vec<String> = lines.map(|line| line.chars().take(LINE).collect()).collect();
        let more = if lines.len() > QUOTED { "; ..." } else { "" };
        (!lines.is_empty()).then(|| format!("{}{more}", lines[..lines.len().min(QUOTED)].join("; ")))
    }

    /// The kind of the error, by its messages.
    pub fn kind(&self) -> ErrorKind {
        let said = PASSING.iter().find(|(words, _)| self.complaints.contains(words));
        said.map_or(ErrorKind::Other, |(_, kind)| *kind)
    }

    /// The error, if there was one.
    pub fn fault(&self) -> Option<String> {
        let said = || self.complaints().map_or(String::new(), |said| format!("; {said}"));
        (!self.status.success()).then(|| format!("{}: {}{}", self.name, self.status, said()))
    }
}

/// Kills every program that runs: to be called before the process ends without unwinding.
pub fn end_all() {
    for process in locked(&RUNNING).iter().filter_map(Weak::upgrade) {
        // Failing means that it has ended.
        let _ = locked(&process).kill();
    }
}

/// The first complaints that come out of a pipe, which is read to its end.
fn complaints(pipe: impl Read, mut listener: Listener) -> String {
    let (mut pipe, mut line, mut kept) = (BufReader::new(pipe), Vec::new(), String::new());
    // Messages from before a broken pipe are still reported.
    while pipe.by_ref().take(LONGEST).read_until(b'\n', &mut line).is_ok_and(|read| read > 0) {
        if let Some(complaint) = listener(&String::from_utf8_lossy(&line)).filter(|_| kept.len() < MOST) {
            kept.push_str(&complaint);
        }
        line.clear();
    }
    kept
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
