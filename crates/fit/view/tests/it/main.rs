//! Tests of pages, in a browser where there is one.

#[allow(dead_code, reason = "one driver for two crates, which do not make the same calls")]
mod browser;
mod clean;
mod differences;
mod film;
mod hostile;
mod notes;
mod page;
mod pages;
mod scenes;
