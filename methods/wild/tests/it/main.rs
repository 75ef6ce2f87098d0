//! WildSplatter's network and its parts.

mod light;
mod network;
