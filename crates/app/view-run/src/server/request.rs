//! Requests, read only as far as their size is bounded.

use super::answer::Answer;
use std::io::{ErrorKind, Read};

/// Most bytes of a head, and most headers.
const MOST_BYTES: usize = 16 * 1024;
const MOST_HEADERS: usize = 64;

/// A request whose head was read.
#[derive(Debug, PartialEq, Eq)]
pub struct Request {
    pub method: String,
    /// Path and query as they were sent.
    pub target: String,
    pub host: Option<String>,
    pub token: Option<String>,
    /// Bytes of the body, as the head says.
    pub length: u64,
    /// The part of the body that came with the head.
    begun: Vec<u8>,
}

impl Request {
    /// Reads a head; none of a client that goes or says nothing.
    pub fn read(from: &mut impl Read) -> Result<Option<Self>, Answer> {
        let (mut bytes, mut filled) = ([0; MOST_BYTES], 0);
        while filled < MOST_BYTES {
            match from.read(&mut bytes[filled..]) {
                Ok(0) => return Ok(None),
                Ok(read) => filled += read,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) if filled == 0 => return Ok(None),
                Err(_) => return Err(Answer::text(408, "expected the whole request, waited in vain")),
            }
            if let Some(request) = Self::parse(&bytes[..filled])? {
                return Ok(Some(request));
            }
        }
        Err(Answer::text(431, format!("expected at most {MOST_BYTES} bytes before the body")))
    }

    /// A request of its first bytes; none if more must come.
    fn parse(bytes: &[u8]) -> Result<Option<Self>, Answer> {
        let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
        let mut head = httparse::Request::new(&mut headers);
        let end = match head.parse(bytes) {
            Ok(httparse::Status::Complete(end)) => end,
            Ok(httparse::Status::Partial) => return Ok(None),
            Err(httparse::Error::TooManyHeaders) => {
                return Err(Answer::text(431, format!("expected at most {MOST_HEADERS} headers")));
            }
            Err(error) => return Err(Answer::text(400, format!("expected a request of HTTP/1.1: {error}"))),
        };
        if value(head.headers, "transfer-encoding")?.is_some() {
            return Err(Answer::text(411, "expected a body with a Content-Length"));
        }
        let text = |text: Option<&str>| text.unwrap_or_default().to_string();
        Ok(Some(Self {
            method: text(head.method),
            target: text(head.path),
            host: value(head.headers, "host")?.map(str::to_string),
            token: value(head.headers, "x-token")?.map(str::to_string),
            length: value(head.headers, "content-length")?.map_or(Ok(0), length)?,
            begun: bytes[end..].to_vec(),
        }))
    }

    /// Path and query.
    pub fn parts(&self) -> (&str, &str) {
        self.target.split_once('?').unwrap_or((&self.target, ""))
    }

    /// True for an answer that takes time or memory: a scene, a picture.
    pub fn is_costly(&self) -> bool {
        self.method == "GET" && !matches!(self.parts().0, "/" | "/progress")
    }

    /// The body, of as many bytes as the head says, which must be few.
    pub fn body(&mut self, from: &mut impl Read) -> Result<Vec<u8>, Answer> {
        let mut body = std::mem::take(&mut self.begun);
        body.truncate(usize::try_from(self.length).unwrap_or(usize::MAX));
        let read = from.take(self.length - body.len() as u64).read_to_end(&mut body);
        match read {
            Ok(_) if body.len() as u64 == self.length => Ok(body),
            _ => Err(Answer::text(400, format!("expected {} bytes, found {}", self.length, body.len()))),
        }
    }
}

/// The value of a header. One that is there twice means two things.
fn value<'h>(headers: &[httparse::Header<'h>], name: &str) -> Result<Option<&'h str>, Answer> {
    let mut all = headers.iter().filter(|header| header.name.eq_ignore_ascii_case(name));
    match (all.next().map(|header| std::str::from_utf8(header.value)), all.next()) {
        (None, _) => Ok(None),
        (Some(Ok(value)), None) => Ok(Some(value)),
        _ => Err(Answer::text(400, format!("expected one {name} of text"))),
    }
}

/// A number of bytes. One beyond 64 bits is taken for the largest.
fn length(digits: &str) -> Result<u64, Answer> {
    if digits.is_empty() || !digits.bytes().all(|digit| digit.is_ascii_digit()) {
        return Err(Answer::text(400, "expected a Content-Length of digits"));
    }
    Ok(digits.parse().unwrap_or(u64::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes that come in parts, which end where `ends` say.
    struct Parts<'a>(&'a [u8], Vec<usize>);

    impl Read for Parts<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
            let part = self.1.pop().unwrap_or(usize::MAX).clamp(1, self.0.len().max(1));
            (&self.0[..part.min(self.0.len())]).read(buffer).inspect(|read| self.0 = &self.0[*read..])
        }
    }

    /// All parts of a request, without regard to the splits on its way.
    fn read(from: &mut impl Read) -> Result<Option<Request>, String> {
        let request = Request::read(from).map_err(|answer| answer.head(""))?;
        Ok(request.map(|request| Request { begun: Vec::new(), ..request }))
    }

    #[test]
    fn a_request_has_its_parts() {
        let bytes = b"POST /save?format=ply HTTP/1.1\r\nhost: a:1\r\nX-TOKEN: t\r\nContent-Length: 3\r\n\r\nabcd";
        let mut rest: &[u8] = &bytes[bytes.len() - 2..];
        let mut request = Request::read(&mut &bytes[..bytes.len() - 2]).unwrap().unwrap();
        assert_eq!(request.parts(), ("/save", "format=ply"));
        assert_eq!((request.host.as_deref(), request.token.as_deref()), (Some("a:1"), Some("t")));
        assert_eq!(request.body(&mut rest).unwrap(), b"abc");
        request.length = 3;
        assert!(request.body(&mut &b"ab"[..]).is_err());
    }

    /// Mutated heads are read or refused, and in parts as at once: a million under stress.
    ///
    /// Promise of `mutated_requests_are_answered_or_refused`.
    #[test]
    fn mutated_heads_are_read_or_refused() {
        let count = if std::env::var_os("WEAVER_STRESS").is_some() { 1_000_000 } else { 20_000 };
        let seed =
            b"POST /save?format=ply HTTP/1.1\r\nHost: 127.0.0.1:80\r\nX-Token: 0123\r\nContent-Length: 35\r\n\r\n";
        let pieces: [&[u8]; 9] = [
            b"\r\n",
            b"\n",
            b"\0",
            b" ",
            b":",
            b"\xff",
            b"Host: a\r\n",
            b"Content-Length: 99999999999999999999\r\n",
            b"9",
        ];
        let mut state = 1_u64;
        let mut below = |end: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize % end.max(1)
        };
        let mut outcomes = [0; 3];
        for _ in 0..count {
            let mut bytes = seed.to_vec();
            for _ in 0..=below(3) {
                let at = below(bytes.len());
                match below(4) {
                    0 => bytes[at] = below(256) as u8,
                    1 => drop(bytes.splice(at..at, pieces[below(pieces.len())].iter().copied())),
                    2 => drop(bytes.drain(at..(at + below(9)).min(bytes.len()))),
                    _ => drop(bytes.splice(at..at, bytes[at..].to_vec().repeat(below(9)))),
                }
                bytes.push(b'\n');
            }
            let whole = read(&mut bytes.as_slice());
            let ends = (0..6).map(|_| below(40)).collect();
            assert_eq!(whole, read(&mut Parts(&bytes, ends)), "{:?}", String::from_utf8_lossy(&bytes));
            outcomes[whole.map_or(2, |request| usize::from(request.is_some()))] += 1;
        }
        assert!(outcomes.iter().all(|count| *count > 0), "{outcomes:?}");
    }
}
