//! The number of a video's snippets in the loss of its bag.

/// Number of the highest of `snippets` scores in the mean of a bag: a sixteenth, and one. Zhou et al., arXiv
/// 2302.05160, code.
pub fn top_k(snippets: usize) -> usize {
    snippets / 16 + 1
}
