//! Parts of the network that a stage leaves as they are.

use crate::{Error, Recipe, StageConfig};
use weaver_autograd::Params;

/// True if a parameter belongs to a part: the part's name is the beginning of its own, up to a dot.
fn belongs(name: &str, part: &str) -> bool {
    let rest = name.strip_prefix(part.trim_end_matches('.'));
    rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

/// Checks that there is a parameter for each name, and that something is left to train.
pub(super) fn check<R: Recipe>(stages: &[StageConfig<R>], params: &Params<f32>) -> Result<(), Error> {
    for (i, stage) in stages.iter().enumerate() {
        let names = || params.iter().map(|(_, param)| param.name());
        if let Some(part) = stage.frozen.iter().find(|part| !names().any(|name| belongs(name, part))) {
            let mut parts: Vec<&str> = names().map(|name| name.split('.').next().unwrap_or(name)).collect();
            parts.dedup();
            let known = format!("expected the beginning of a parameter's name, such as {}", parts.join(", "));
            return Err(Error::Input(format!("stages.{i}.frozen: {known}, found `{part}`")));
        }
        if names().all(|name| stage.frozen.iter().any(|part| belongs(name, part))) {
            return Err(Error::Input(format!("stages.{i}.frozen: expected a part that is left to train, found none")));
        }
    }
    Ok(())
}

/// Freezes the parts, and nothing else.
pub(super) fn apply(parts: &[String], params: &mut Params<f32>) {
    let wanted = |name: &str| parts.iter().any(|part| belongs(name, part));
    let changed: Vec<_> =
        params.iter().filter(|(_, p)| p.is_frozen() != wanted(p.name())).map(|(id, p)| (id, !p.is_frozen())).collect();
    changed.into_iter().for_each(|(id, frozen)| params.set_frozen(id, frozen));
}
