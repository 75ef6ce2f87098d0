//! Events between the working thread and the thread that Python called from.

use std::io::{self, Write};
use std::panic;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, SyncSender, sync_channel};
use weaver_command::{Failure, Part};

/// An event of the work.
pub enum Event {
    /// A line of progress, a note or a warning.
    Line(String),
    /// A part that is done; the work waits for the answer.
    Part(Part, SyncSender<()>),
    /// The end, with the standard output.
    End(Result<String, Failure>),
}

/// The end of abandoned work, as the payload of an unwinding thread.
pub struct Abandoned;

/// The sending side, which ends the work once the receiver is gone.
#[derive(Clone)]
pub struct Voice {
    events: Sender<Event>,
    abandoned: Arc<AtomicBool>,
}

impl Voice {
    pub fn new(events: Sender<Event>, abandoned: Arc<AtomicBool>) -> Self {
        Self { events, abandoned }
    }

    /// Sends an event.
    ///
    /// # Panics
    /// Unwinds with [`Abandoned`], silently, once the receiver is gone.
    pub fn say(&self, event: Event) {
        if self.abandoned.load(Ordering::Relaxed) || self.events.send(event).is_err() {
            panic::resume_unwind(Box::new(Abandoned));
        }
    }

    /// Sends a part and waits until it was handled.
    pub fn part(&self, part: &Part) {
        let (answer, answered) = sync_channel(1);
        self.say(Event::Part(part.clone(), answer));
        // An answer that never comes means that the receiver is gone; the next event then ends the work.
        let _ = answered.recv();
    }
}

/// Standard error as lines.
pub struct Lines {
    voice: Voice,
    begun: Vec<u8>,
}

impl Lines {
    pub fn new(voice: Voice) -> Self {
        Self { voice, begun: Vec::new() }
    }
}

impl Write for Lines {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.begun.extend_from_slice(bytes);
        while let Some(end) = self.begun.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = self.begun.drain(..=end).collect();
            self.voice.say(Event::Line(String::from_utf8_lossy(&line[..end]).into_owned()));
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
