//! Every kernel against a slow twin, in both precisions, and at more than one thread count.

mod special;
