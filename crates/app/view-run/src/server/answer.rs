//! Answers with the headers that every one has.

/// An answer, not yet sent.
#[derive(Debug)]
pub struct Answer {
    status: u16,
    kind: &'static str,
    pub body: Vec<u8>,
    /// Its content security policy; `None` takes the page's.
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

    /// A report, which has styles, pictures and scripts of its own and sends no requests.
    pub fn report(page: String) -> Self {
        let policy = "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; script-src 'unsafe-inline'; worker-src blob:; \
                      frame-src 'self'; sandbox allow-scripts allow-downloads";
        Self { policy: Some(policy), ..Self::html(page) }
    }

    pub fn nothing() -> Self {
        Self::text(404, "nothing is here")
    }

    /// The bytes before the body. The connection ends after it.
    pub fn head(&self, policy: &str) -> String {
        let (status, reason, length, kind) = (self.status, reason(self.status), self.body.len(), self.kind);
        let policy = self.policy.unwrap_or(policy);
        format!(
            "HTTP/1.1 {status} {reason}\r\nConnection: close\r\nContent-Length: {length}\r\nContent-Type: {kind}\r\n\
             Content-Security-Policy: {policy}\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\
             Cross-Origin-Resource-Policy: same-origin\r\nCache-Control: no-store\r\n\r\n"
        )
    }
}

/// The words of a status.
fn reason(status: u16) -> &'static str {
    match status {
        200 => "OK",
        400 => "Bad Request",
        403 => "Forbidden",
        404 => "Not Found",
        405 => "Method Not Allowed",
        408 => "Request Timeout",
        409 => "Conflict",
        411 => "Length Required",
        413 => "Content Too Large",
        431 => "Request Header Fields Too Large",
        503 => "Service Unavailable",
        _ => "Internal Server Error",
    }
}
