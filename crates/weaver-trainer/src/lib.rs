//! Training loop, checkpoints, evaluation and observers for SplatWeaver.
