//! Losses of the method, and image metrics without a tape.
