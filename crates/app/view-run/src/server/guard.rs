//! Admission of requests.

use super::answer::Answer;
use super::listener::{Access, Listener};
use super::request::Request;
use crate::Error;

/// Conditions that a request must meet.
#[derive(Debug)]
pub struct Guard {
    pub port: u16,
    pub token: String,
    pub access: Access,
}

impl Guard {
    /// The guard of a port, with a token of its own.
    pub fn of(listener: &Listener) -> Result<Self, Error> {
        Ok(Self { port: listener.port, token: super::random()?, access: listener.access })
    }

    /// Refuses requests for other hosts, which pages from elsewhere make under names of their own, and requests without
    /// the token where it is needed.
    pub fn check(&self, request: &Request, query: &str, writes: bool) -> Result<(), Answer> {
        let host = request.host.as_deref().unwrap_or_default();
        let own = ["127.0.0.1", "localhost"].map(|name| format!("{name}:{}", self.port));
        if self.access == Access::Local && !own.iter().any(|own| own == host) {
            return Err(Answer::text(403, "expected this machine as the host"));
        }
        let needed = writes || self.access == Access::Network;
        // A form of another page can bring a query, but no header.
        let given = request.token.as_deref().or_else(|| value(query, "token").filter(|_| !writes));
        if needed && !given.is_some_and(|given| equal(given, &self.token)) {
            return Err(Answer::text(403, "expected the token of the address that was printed"));
        }
        Ok(())
    }
}

/// The value of a key of a query.
pub fn value<'q>(query: &'q str, key: &str) -> Option<&'q str> {
    query.split('&').filter_map(|pair| pair.split_once('=')).find(|(name, _)| *name == key).map(|(_, value)| value)
}

/// True if two texts are equal, found in a time that does not depend on where they differ.
fn equal(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |differ, (x, y)| differ | (x ^ y)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn queries_have_values() {
        assert_eq!(value("since=7&token=a", "token"), Some("a"));
        assert_eq!(value("since=7", "token"), None);
        assert_eq!(value("", ""), None);
    }

    #[test]
    fn texts_are_compared_whole() {
        assert!(equal("abc", "abc") && !equal("abc", "abd") && !equal("abc", "ab") && equal("", ""));
    }
}
