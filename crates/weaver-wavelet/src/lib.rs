//! Haar and db2 wavelet analysis and synthesis as differentiable operators, and the high-frequency prior.
