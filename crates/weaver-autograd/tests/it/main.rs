//! Tests of the tape and of every built-in op.

mod tape;
