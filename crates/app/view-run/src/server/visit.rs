//! One connection, with a bound on every wait.

use super::answer::Answer;
use super::clients::{Clients, Phase};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Bytes that are written at a time.
const PART: usize = 1 << 16;

/// A connected client, with one request and one answer.
#[derive(Debug)]
pub struct Visit<'a> {
    clients: &'a Clients,
    stream: Arc<TcpStream>,
    number: u64,
    /// Time when the request, or the answer, began, and its bytes since.
    began: Instant,
    bytes: usize,
}

impl<'a> Visit<'a> {
    /// A client that has a seat until this is dropped.
    pub fn new(clients: &'a Clients, stream: TcpStream) -> Self {
        let stream = Arc::new(stream);
        let number = clients.admit(stream.clone());
        Self { clients, stream, number, began: Instant::now(), bytes: 0 }
    }

    /// Makes an answer, a costly one when there is room for it, sends it, and ends the connection.
    ///
    /// # Errors
    /// When the client has gone, or takes too long.
    pub fn answer(mut self, policy: &str, costly: bool, make: impl FnOnce() -> Answer) -> io::Result<()> {
        self.clients.moved(self.number, Phase::Making);
        let making = costly.then(|| self.clients.make_room());
        if let Some(None) = making {
            let busy = Answer::text(503, "others are being answered: try again");
            return self.send(&busy, policy);
        }
        let answer = make();
        let held = self.clients.hold(answer.body.len());
        drop(making);
        let sent = self.send(&answer, policy);
        drop((answer, held));
        sent?;
        self.take_leave()
    }

    fn send(&mut self, answer: &Answer, policy: &str) -> io::Result<()> {
        (self.began, self.bytes) = (Instant::now(), 0);
        self.clients.moved(self.number, Phase::Sending);
        self.write_all(answer.head(policy).as_bytes())?;
        self.write_all(&answer.body)?;
        self.stream.shutdown(Shutdown::Write)
    }

    /// Waits a little for the client's end: unread bytes that it still sends would reset the connection, and the answer
    /// be lost.
    fn take_leave(&mut self) -> io::Result<()> {
        self.clients.moved(self.number, Phase::Asking);
        let (began, mut dropped) = (Instant::now(), [0; 4096]);
        loop {
            let left = self.clients.limits.leave.saturating_sub(began.elapsed());
            if left.is_zero() {
                return Ok(());
            }
            self.stream.set_read_timeout(Some(left))?;
            if (&*self.stream).read(&mut dropped)? == 0 {
                return Ok(());
            }
        }
    }

    /// Time for the next byte.
    fn patience(&self, silence: Duration) -> io::Result<Duration> {
        let limits = &self.clients.limits;
        let allowed = limits.grace + Duration::from_secs_f64(self.bytes as f64 / limits.rate);
        let left = allowed.saturating_sub(self.began.elapsed());
        if left.is_zero() { Err(ErrorKind::TimedOut.into()) } else { Ok(left.min(silence)) }
    }

    fn moved(&mut self, bytes: usize, phase: Phase) -> usize {
        self.bytes += bytes;
        self.clients.moved(self.number, phase);
        bytes
    }
}

impl Read for Visit<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.stream.set_read_timeout(Some(self.patience(self.clients.limits.asking)?))?;
        let read = (&*self.stream).read(buffer)?;
        Ok(self.moved(read, Phase::Asking))
    }
}

impl Write for Visit<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.stream.set_write_timeout(Some(self.patience(self.clients.limits.sending)?))?;
        let written = (&*self.stream).write(&bytes[..bytes.len().min(PART)])?;
        Ok(self.moved(written, Phase::Sending))
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for Visit<'_> {
    fn drop(&mut self) {
        self.clients.leave(self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::server::clients::Limits;
    use crate::server::request::Request;
    use std::net::{Ipv4Addr, TcpListener};

    const SHORT: Limits = Limits {
        seats: 2,
        bytes: 1,
        room: Duration::from_millis(300),
        asking: Duration::from_millis(100),
        sending: Duration::from_millis(100),
        grace: Duration::from_millis(300),
        leave: Duration::from_millis(50),
        ..Limits::USUAL
    };
    /// A bound for work of a fraction of a second.
    const SOON: Duration = Duration::from_secs(20);

    /// Both ends of a connection, the client's first.
    fn ends() -> [TcpStream; 2] {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        [client, listener.accept().unwrap().0]
    }

    /// A byte now and then does not prolong a request for ever.
    ///
    /// Promise (servers): a byte now and then holds a connection no longer than a bound.
    #[test]
    fn a_slow_client_is_let_go() {
        let clients = Clients::new(SHORT);
        let ([mut client, server], begin) = (ends(), Instant::now());
        let mut visit = Visit::new(&clients, server);
        std::thread::scope(|scope| {
            scope.spawn(move || {
                while begin.elapsed() < SOON && client.write_all(b"a").is_ok() {
                    std::thread::sleep(Duration::from_millis(10));
                }
            });
            let refused = Request::read(&mut visit).unwrap_err();
            assert!(refused.head("").starts_with("HTTP/1.1 408 "), "{refused:?}");
            drop(visit);
        });
        assert!(begin.elapsed() < SOON, "{:?}", begin.elapsed());
    }

    /// A client that takes nothing of its answer is let go, and so are the bytes that waited for it.
    ///
    /// Promise of `a_slow_client_is_let_go`.
    #[test]
    fn a_client_that_does_not_read_is_let_go() {
        let clients = Clients::new(SHORT);
        let ([_client, server], begin) = (ends(), Instant::now());
        let large = || Answer::new("text/plain", vec![0; 64 << 20]);
        assert!(Visit::new(&clients, server).answer("", true, large).is_err());
        assert!(begin.elapsed() < SOON && clients.make_room().is_some());
    }

    /// While enough bytes wait for their readers, other clients are refused within a bounded time.
    ///
    /// Promise (servers): how far a run is, and its end, wait for no room.
    #[test]
    fn bytes_that_wait_are_bounded() {
        let clients = Clients::new(SHORT);
        let _held = clients.hold(1);
        let [mut client, server] = ends();
        Visit::new(&clients, server).answer("", true, || unreachable!("there is no room")).unwrap();
        let mut answer = String::new();
        client.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 503 "), "{answer}");
        // Cheap requests are answered all the same: a run's progress, and its stop.
        let [mut client, server] = ends();
        // The client is still there when its time to leave is over.
        let _ = Visit::new(&clients, server).answer("", false, Answer::nothing);
        answer.clear();
        client.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 404 "), "{answer}");
    }

    /// Where all seats are taken, the one that has been still for longest is given to the next.
    ///
    /// Promise (servers): the stillest of 64 connections gives way to the next.
    #[test]
    fn the_stillest_gives_way() {
        let clients = Clients::new(SHORT);
        let pairs = [(); 3].map(|()| ends());
        let [[mut first, a], [mut second, b], [_third, c]] = pairs;
        let _visits = [a, b].map(|stream| Visit::new(&clients, stream));
        let begin = Instant::now();
        while !clients.has_seat() {
            assert!(begin.elapsed() < SOON);
            std::thread::sleep(Duration::from_millis(5));
        }
        let _visit = Visit::new(&clients, c);
        assert_eq!(first.read(&mut [0]).unwrap(), 0);
        second.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
        assert_eq!(second.read(&mut [0]).unwrap_err().kind(), ErrorKind::WouldBlock);
    }
}
