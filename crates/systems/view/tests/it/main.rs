//! Tests of pages, in a browser where there is one.

mod browser;
mod differences;
mod hostile;
mod page;
mod pages;
mod scenes;
