//! Tests of pages, in a browser where there is one.

#[allow(dead_code, reason = "one driver for two crates, which do not make the same calls")]
mod browser;
mod differences;
mod hostile;
mod page;
mod pages;
mod scenes;
