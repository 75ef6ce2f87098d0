//! The number of snippets that a video is judged by.

/// Number of `snippets` that a bag is judged by: a sixteenth, and one. Zhou et al., arXiv 2302.05160, code.
pub fn top_k(snippets: usize) -> usize {
    snippets / 16 + 1
}
