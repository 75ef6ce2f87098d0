//! Answers with the headers that every one has.

use std::io::{self, Write};
use tiny_http::{Method, Request, StatusCode};

/// An answer, not yet sent.
#[derive(Debug)]
pub struct Answer {
    status: u16,
    kind: &'static str,
    body: Vec<u8>,
    /// Its content security policy; that of the page if `None`.
    policy: Option<&'static str>,
}

impl Answer {
    pub fn new(kind: &'static str, body: Vec<u8>) -> Self {
        Self { status: 200, kind, body, policy: None }
    }

    pub fn text(status: u16, text: impl Into<String>) -> Self {
        Self { status, ..Self::new("text/plain; charset=utf-8", text.into().into_bytes()) }
    }

    pub fn html(page: String) -> Self {
        Self::new("text/html; charset=utf-8", page.into_bytes())
    }

    /// A report, which has styles, pictures and scripts of its own and asks nobody.
    pub fn report(page: String) -> Self {
        let policy = "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; script-src 'unsafe-inline'; worker-src blob:; \
                      frame-src 'self'; sandbox allow-scripts allow-downloads";
        Self { policy: Some(policy), ..Self::html(page) }
    }

    pub fn nothing() -> Self {
        Self::text(404, "nothing is here")
    }

    /// Sends the answer, and asks the client to close the connection: of connections that stay open, tiny_http serves four, and lets those
    /// that come at the same time wait for one of them to end.
    pub fn send(self, request: Request, policy: &str) -> io::Result<()> {
        let wants_body = *request.method() != Method::Head;
        let (status, length) = (StatusCode(self.status), self.body.len());
        let (kind, policy) = (self.kind, self.policy.unwrap_or(policy));
        let mut writer = request.into_writer();
        write!(
            writer,
            "HTTP/1.1 {} {}\r\nConnection: close\r\nContent-Length: {length}\r\nContent-Type: {kind}\r\n\
             Content-Security-Policy: {policy}\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\
             Cross-Origin-Resource-Policy: same-origin\r\nCache-Control: no-store\r\n\r\n",
            status.0,
            status.default_reason_phrase(),
        )?;
        writer.write_all(if wants_body { &self.body } else { &[] })?;
        writer.flush()
    }
}
