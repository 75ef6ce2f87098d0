//! Answers with the headers that every one has.

use std::io::Cursor;
use tiny_http::{Header, Response};

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

    pub fn response(self, policy: &str) -> Response<Cursor<Vec<u8>>> {
        let headers = [
            ("Content-Type", self.kind),
            ("Content-Security-Policy", self.policy.unwrap_or(policy)),
            ("X-Content-Type-Options", "nosniff"),
            ("Referrer-Policy", "no-referrer"),
            ("Cross-Origin-Resource-Policy", "same-origin"),
            ("Cache-Control", "no-store"),
        ];
        let response = Response::from_data(self.body).with_status_code(self.status).with_chunked_threshold(usize::MAX);
        headers.into_iter().fold(response, |response, (name, value)| {
            response.with_header(Header::from_bytes(name, value).expect("headers are plain text"))
        })
    }
}
