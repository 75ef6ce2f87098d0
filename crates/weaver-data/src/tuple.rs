//! Which views of a scene go together.

/// Views of one scene that are shown (`context`) and views to be rendered (`targets`).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tuple {
    /// Index of the scene.
    pub scene: usize,
    /// View indices; the first is camera 0, whose frame everything is expressed in.
    pub context: Vec<usize>,
    /// View indices.
    pub targets: Vec<usize>,
}
