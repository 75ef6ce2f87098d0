//! Views of a scene that go together.

/// A choice of views of one scene: given ones (`context`) and ones to render (`targets`).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tuple {
    /// Index of the scene.
    pub scene: usize,
    /// Indices of the given views. The first is camera 0, in whose frame everything is expressed.
    pub context: Vec<usize>,
    /// Indices of the views to render.
    pub targets: Vec<usize>,
}
