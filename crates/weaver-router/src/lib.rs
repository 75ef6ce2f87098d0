//! Pixel router, straight-through Gumbel sampling, cardinality experts, allocation and neighbour attention.
