//! Words of a text that is read a part at a time.

use crate::files::content::Content;
use crate::{Error, Result};
use flate2::Crc;
use std::fmt::Display;
use std::ops::Range;
use std::path::Path;
use std::str::FromStr;

/// Bytes that are read at a time.
const PART: usize = 1 << 20;
/// Bytes of a name or number that still are one.
const LONGEST: usize = 1 << 10;

/// A piece of the text. Comments and space lie between.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Token {
    /// A name, keyword or number.
    Word(String),
    /// In quotes.
    Quoted(String),
    /// A path or a file's name, in brackets of their own.
    Reference,
    /// Another character.
    Symbol(char),
    End,
}

impl Token {
    /// The token in messages.
    fn named(&self) -> String {
        match self {
            Self::Word(word) => word.clone(),
            Self::Quoted(text) => format!("{text:?}"),
            Self::Reference => "a reference".into(),
            Self::Symbol(symbol) => symbol.to_string(),
            Self::End => "the end".into(),
        }
    }
}

pub(super) struct Text<'a> {
    path: &'a Path,
    content: &'a Content<'a>,
    /// Bytes that are not in `part` yet.
    left: Range<usize>,
    part: Vec<u8>,
    at: usize,
    line: usize,
    peeked: Option<Token>,
    crc: Crc,
    checksum: Option<u32>,
}

impl<'a> Text<'a> {
    /// The text at this place.
    pub(super) fn new(path: &'a Path, content: &'a Content<'a>, place: Range<usize>) -> Self {
        let (part, crc) = (Vec::new(), Crc::new());
        Self { path, content, left: place, part, at: 0, line: 1, peeked: None, crc, checksum: None }
    }

    /// With a checksum that all bytes have to have, once they are read.
    pub(super) fn with_checksum(self, checksum: u32) -> Self {
        Self { checksum: Some(checksum), ..self }
    }

    pub(super) fn path(&self) -> &'a Path {
        self.path
    }

    pub(super) fn invalid(&self, expected: impl Display, found: impl Display) -> Error {
        Error::invalid(self.path, format!("line {}", self.line), expected, found)
    }

    fn byte(&mut self) -> Result<Option<u8>> {
        if self.at == self.part.len() {
            let end = self.left.end.min(self.left.start + PART);
            if self.left.start == end {
                return Ok(None);
            }
            self.part = self.content.part(self.left.start..end)?.into_owned();
            self.crc.update(&self.part);
            (self.left.start, self.at) = (end, 0);
        }
        Ok(Some(self.part[self.at]))
    }

    fn pass(&mut self, byte: u8) {
        self.at += 1;
        self.line += usize::from(byte == b'\n');
    }

    /// The rest of the line.
    pub(super) fn rest_of_line(&mut self) -> Result<String> {
        let mut rest = Vec::new();
        while let Some(byte) = self.byte()?.filter(|byte| *byte != b'\n') {
            if rest.len() < LONGEST {
                rest.push(byte);
            }
            self.pass(byte);
        }
        Ok(String::from_utf8_lossy(&rest).trim_end().into())
    }

    pub(super) fn peek(&mut self) -> Result<&Token> {
        if self.peeked.is_none() {
            self.peeked = Some(self.token()?);
        }
        Ok(self.peeked.as_ref().expect("just set"))
    }

    pub(super) fn next(&mut self) -> Result<Token> {
        match self.peeked.take() {
            Some(token) => Ok(token),
            None => self.token(),
        }
    }

    fn token(&mut self) -> Result<Token> {
        while let Some(byte) = self.byte()? {
            match byte {
                b'#' => drop(self.rest_of_line()?),
                b' ' | b'\t' | b'\r' | b'\n' | b';' => self.pass(byte),
                b'"' | b'\'' => return self.quoted(byte),
                b'@' | b'<' => return self.reference(byte),
                _ if is_word(byte) => return self.word(),
                _ => {
                    self.pass(byte);
                    return Ok(Token::Symbol(byte.into()));
                }
            }
        }
        match self.checksum {
            Some(checksum) if checksum != self.crc.sum() => {
                let [expected, found] = [checksum, self.crc.sum()].map(|sum| format!("{sum:08x}"));
                Err(Error::invalid(self.path, "checksum", expected, found))
            }
            _ => Ok(Token::End),
        }
    }

    fn word(&mut self) -> Result<Token> {
        let mut word = Vec::new();
        while self.byte()?.is_some_and(is_word) {
            let rest = &self.part[self.at..];
            let length = rest.iter().take_while(|byte| is_word(**byte)).count();
            word.extend(&rest[..length]);
            self.at += length;
            if word.len() > LONGEST {
                return Err(self.invalid(format!("a word of at most {LONGEST} bytes"), "a longer one"));
            }
        }
        let word = String::from_utf8(word).map_err(|e| self.invalid("UTF-8", e))?;
        Ok(Token::Word(word))
    }

    /// Text in quotes of one kind, single or triple.
    fn quoted(&mut self, quote: u8) -> Result<Token> {
        let mut quotes = 0;
        while let Some(byte) = self.byte()?.filter(|byte| *byte == quote && quotes < 3) {
            quotes += 1;
            self.pass(byte);
        }
        if quotes == 2 {
            return Ok(Token::Quoted(String::new()));
        }
        // The quotes at the end come one after the other.
        let (mut text, mut seen) = (Vec::new(), 0);
        while seen < quotes {
            let Some(byte) = self.byte()? else {
                return Err(self.invalid("a quote at the end of a text", "the end"));
            };
            self.pass(byte);
            seen = if byte == quote { seen + 1 } else { 0 };
            if byte == b'\\' {
                self.byte()?.iter().for_each(|escaped| self.pass(*escaped));
            }
            // Names are short, and nothing else is asked for.
            if seen == 0 && text.len() < LONGEST {
                text.push(byte);
            }
        }
        Ok(Token::Quoted(String::from_utf8_lossy(&text).into_owned()))
    }

    fn reference(&mut self, start: u8) -> Result<Token> {
        self.pass(start);
        let end = if start == b'<' { b'>' } else { start };
        while let Some(byte) = self.byte()? {
            self.pass(byte);
            if byte == end {
                return Ok(Token::Reference);
            }
        }
        Err(self.invalid(format!("a reference up to {}", end as char), "the end"))
    }

    /// Takes the next token if it is this character.
    pub(super) fn takes(&mut self, symbol: char) -> Result<bool> {
        let found = *self.peek()? == Token::Symbol(symbol);
        if found {
            self.peeked = None;
        }
        Ok(found)
    }

    pub(super) fn expect(&mut self, symbol: char) -> Result<()> {
        let found = self.next()?;
        if found == Token::Symbol(symbol) { Ok(()) } else { Err(self.unexpected(symbol, &found)) }
    }

    pub(super) fn unexpected(&self, expected: impl Display, found: &Token) -> Error {
        self.invalid(expected, found.named())
    }

    pub(super) fn name(&mut self, expected: &str) -> Result<String> {
        match self.next()? {
            Token::Word(word) => Ok(word),
            other => Err(self.unexpected(expected, &other)),
        }
    }

    pub(super) fn quoted_name(&mut self) -> Result<String> {
        match self.next()? {
            Token::Quoted(name) => Ok(name),
            other => Err(self.unexpected("a name in quotes", &other)),
        }
    }

    /// Adds numbers: `width` of them in parentheses, or one without.
    pub(super) fn tuple<T: FromStr>(&mut self, width: usize, numbers: &mut Vec<T>) -> Result<()> {
        let word = |text: &mut Self| {
            let word = text.name("a number")?;
            word.parse().map_err(|_| text.invalid("a number", word))
        };
        if width == 1 {
            numbers.push(word(self)?);
            return Ok(());
        }
        self.expect('(')?;
        for i in 0..width {
            if i > 0 {
                self.expect(',')?;
            }
            numbers.push(word(self)?);
        }
        self.expect(')')
    }

    /// Calls `element` for each of a list in brackets, between commas.
    pub(super) fn list(&mut self, mut element: impl FnMut(&mut Self) -> Result<()>) -> Result<()> {
        self.expect('[')?;
        while !self.takes(']')? {
            element(self)?;
            if !self.takes(',')? {
                return self.expect(']');
            }
        }
        Ok(())
    }

    /// Passes over a value, with all that is in its brackets.
    pub(super) fn skip(&mut self) -> Result<()> {
        let mut depth = 0_usize;
        loop {
            match self.next()? {
                Token::Symbol('(' | '[' | '{') => depth += 1,
                Token::Symbol(')' | ']' | '}') if depth > 0 => depth -= 1,
                found @ (Token::Symbol(')' | ']' | '}' | '=') | Token::End) if depth == 0 => {
                    return Err(self.unexpected("a value", &found));
                }
                Token::End => return Err(self.invalid("closing brackets", "the end")),
                _ => {}
            }
            if depth == 0 {
                return Ok(());
            }
        }
    }
}

fn is_word(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b':' | b'.' | b'-' | b'+' | 0x80..)
}
