//! Camera head with iterative refinement, pose codes to cameras, and pose metrics.
