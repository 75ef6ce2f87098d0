//! Connections under way, and the bounds within which they are.

use std::net::{Shutdown, TcpStream};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Bounds of the resources of clients.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Connections at the same time. Further ones wait in the system's queue.
    pub seats: usize,
    /// Answers that are made at the same time.
    pub makers: usize,
    /// Bytes of answers that wait for their readers. Beyond that no other answer is begun.
    pub bytes: usize,
    /// Longest wait for room below [`bytes`](Self::bytes).
    pub room: Duration,
    /// Longest silence of a client within its request.
    pub asking: Duration,
    /// Longest time in which a client takes nothing of its answer: pages draw meanwhile, which may take seconds.
    pub sending: Duration,
    /// Time for a request, and for an answer, beyond the time of its bytes at the least rate.
    pub grace: Duration,
    /// Least bytes per second.
    pub rate: f64,
    /// Time for a client to take leave, and for all of them to end when the server does.
    pub leave: Duration,
}

impl Limits {
    pub const USUAL: Self = Self {
        seats: 64,
        makers: 4,
        bytes: 256 << 20,
        room: Duration::from_secs(10),
        asking: Duration::from_secs(5),
        sending: Duration::from_secs(30),
        grace: Duration::from_secs(10),
        rate: 16384.0,
        leave: Duration::from_secs(1),
    };
}

/// A state of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// The client sends its request, or takes leave.
    Asking,
    /// The answer is being made.
    Making,
    /// The answer is on its way.
    Sending,
}

impl Phase {
    /// Idle time after which another connection may take the place of this one.
    fn patience(self) -> Duration {
        match self {
            Self::Asking => Duration::from_millis(100),
            Self::Making => Duration::MAX,
            Self::Sending => Duration::from_secs(1),
        }
    }
}

/// All connections of a server.
#[derive(Debug)]
pub struct Clients {
    pub limits: Limits,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    seats: Vec<Seat>,
    /// Connections that there were.
    count: u64,
    making: usize,
    bytes: usize,
    closed: bool,
}

#[derive(Debug)]
struct Seat {
    number: u64,
    stream: Arc<TcpStream>,
    phase: Phase,
    /// When a byte of it was read or written last.
    moved: Instant,
}

impl Clients {
    pub fn new(limits: Limits) -> Self {
        Self { limits, state: Mutex::default(), changed: Condvar::new() }
    }

    /// True if another connection may begin. Where all seats are taken, the one that has been still for longest is
    /// closed.
    pub fn has_seat(&self) -> bool {
        let mut state = self.lock();
        if state.seats.len() >= self.limits.seats {
            state.close_stillest(&[Phase::Asking, Phase::Sending]);
        }
        state.seats.len() < self.limits.seats
    }

    /// Gives a connection a seat, and its number.
    pub fn admit(&self, stream: Arc<TcpStream>) -> u64 {
        let mut state = self.lock();
        state.count += 1;
        let number = state.count;
        state.seats.push(Seat { number, stream, phase: Phase::Asking, moved: Instant::now() });
        number
    }

    /// Notes that a connection has moved, and its phase.
    pub fn moved(&self, number: u64, phase: Phase) {
        if let Some(seat) = self.lock().seats.iter_mut().find(|seat| seat.number == number) {
            (seat.phase, seat.moved) = (phase, Instant::now());
        }
    }

    pub fn leave(&self, number: u64) {
        self.lock().seats.retain(|seat| seat.number != number);
        self.changed.notify_all();
    }

    /// Room to make an answer; none if there is none for too long.
    pub fn make_room(&self) -> Option<Making<'_>> {
        let until = Instant::now() + self.limits.room;
        let mut state = self.lock();
        while state.making >= self.limits.makers || state.bytes >= self.limits.bytes {
            if state.closed || Instant::now() >= until {
                return None;
            }
            if state.bytes >= self.limits.bytes {
                state.close_stillest(&[Phase::Sending]);
            }
            let waited = self.changed.wait_timeout(state, Phase::Asking.patience());
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        state.making += 1;
        Some(Making(self))
    }

    /// Bytes that wait for their reader while this is kept.
    pub fn hold(&self, bytes: usize) -> Held<'_> {
        self.lock().bytes += bytes;
        Held(self, bytes)
    }

    /// Ends all connections. A request that was read is answered, if that takes no longer than taking leave.
    pub fn close(&self) {
        let mut state = self.lock();
        state.closed = true;
        state.shut(Shutdown::Read);
        self.changed.notify_all();
        let leaving = |state: &mut State| !state.seats.is_empty();
        let waited = self.changed.wait_timeout_while(state, self.limits.leave, leaving);
        waited.unwrap_or_else(PoisonError::into_inner).0.shut(Shutdown::Both);
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn close_stillest(&mut self, phases: &[Phase]) {
        let still = |seat: &Seat| phases.contains(&seat.phase) && seat.moved.elapsed() >= seat.phase.patience();
        let stillest = self.seats.iter().enumerate().filter(|(_, seat)| still(seat)).min_by_key(|(_, seat)| seat.moved);
        if let Some((at, _)) = stillest {
            let _ = self.seats.swap_remove(at).stream.shutdown(Shutdown::Both);
        }
    }

    /// Ends reading, which wakes threads that wait for a client, or writing as well. A connection that is gone needs no
    /// end.
    fn shut(&self, how: Shutdown) {
        self.seats.iter().for_each(|seat| drop(seat.stream.shutdown(how)));
    }
}

/// The making of an answer.
#[derive(Debug)]
pub struct Making<'a>(&'a Clients);

impl Drop for Making<'_> {
    fn drop(&mut self) {
        self.0.lock().making -= 1;
        self.0.changed.notify_all();
    }
}

/// Bytes that wait for their reader.
#[derive(Debug)]
pub struct Held<'a>(&'a Clients, usize);

impl Drop for Held<'_> {
    fn drop(&mut self) {
        self.0.lock().bytes -= self.1;
        self.0.changed.notify_all();
    }
}
