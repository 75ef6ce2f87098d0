//! Remarks about photos.

/// Names of photos in a remark, at most.
const NAMED: usize = 8;

/// Remark, where masks are not read, about the photos that have transparent parts; `None` if none has.
pub(crate) fn transparent(names: &[String]) -> Option<String> {
    let have = if names.len() == 1 { "has" } else { "have" };
    let rest = "transparent parts, which are laid over the background; --masks leaves these out";
    (!names.is_empty()).then(|| format!("{} {have} {rest}", some_of(names)))
}

/// The first of the names, and how many more there are.
pub fn some_of(names: &[String]) -> String {
    let shown = names[..names.len().min(NAMED)].join(", ");
    if names.len() > NAMED { format!("{shown} and {} more", names.len() - NAMED) } else { shown }
}
