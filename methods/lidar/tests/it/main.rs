//! Integration tests.

mod hall;
mod real_scans;
mod registration;
mod track;
