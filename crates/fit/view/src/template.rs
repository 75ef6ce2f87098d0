//! Text with places to fill.

/// Fills places `{{name}}` of a text, once and from left to right: filled text is not searched again.
///
/// # Panics
/// When a place has no value, which is a fault of the template.
pub(crate) fn fill(template: &str, values: &[(&str, &str)]) -> String {
    let (first, others) = template.split_once("{{").unwrap_or((template, ""));
    let mut filled = String::with_capacity(template.len() + values.iter().map(|(_, value)| value.len()).sum::<usize>());
    filled.push_str(first);
    for part in others.split("{{").filter(|part| !part.is_empty()) {
        let (name, rest) = part.split_once("}}").expect("a place has an end");
        let value = values.iter().find(|(other, _)| *other == name).expect("a place has a value").1;
        filled.push_str(value);
        filled.push_str(rest);
    }
    filled
}

/// Text as HTML shows it, in elements and in attributes in double quotes.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_filled_in_is_not_filled_again() {
        assert_eq!(fill("a {{x}} b {{y}}.", &[("x", "{{y}}"), ("y", "2")]), "a {{y}} b 2.");
        assert_eq!(fill("nothing", &[]), "nothing");
    }

    #[test]
    fn markup_becomes_text() {
        assert_eq!(escape("<b a=\"1\">&"), "&lt;b a=&quot;1&quot;&gt;&amp;");
    }
}
