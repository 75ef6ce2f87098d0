//! `splatweaver bench`.

mod engine;
