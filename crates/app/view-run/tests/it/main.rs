//! Tests of the server, and of pages that it sends in a browser where there is one.
#![cfg_attr(not(unix), allow(unused, reason = "some tests are of what Unix systems have alone"))]

#[allow(dead_code, reason = "one driver for two crates, which do not make the same calls")]
#[path = "../../../../fit/view/tests/it/browser.rs"]
mod browser;
mod hostile;
mod report;
mod scene_page;
mod server;
mod visit;
