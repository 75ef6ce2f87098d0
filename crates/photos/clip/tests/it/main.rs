//! Clips of all kinds, drawn and encoded here, and the frames that come of them.

mod colors;
mod drawing;
mod fields;
mod refused;
mod times;
mod turns;
