//! One document: Markdown to HTML, with an anchor at each heading.

use crate::tidy;
use pulldown_cmark::{CowStr, Event, HeadingLevel, Options, Parser, Tag, TagEnd, html};
use std::collections::BTreeSet;

/// A document.
pub struct Page {
    pub title: String,
    /// Anchors of its headings.
    pub anchors: BTreeSet<String>,
    text: String,
}

impl Page {
    pub fn new(text: String) -> Self {
        let (mut title, mut anchors) = (String::new(), BTreeSet::new());
        let mut heading: Option<(HeadingLevel, String)> = None;
        for event in Parser::new_ext(&text, options()) {
            match (event, &mut heading) {
                (Event::Start(Tag::Heading { level, .. }), _) => heading = Some((level, String::new())),
                (Event::Text(part) | Event::Code(part), Some((_, name))) => name.push_str(&part),
                (Event::End(TagEnd::Heading(_)), _) => {
                    let (level, name) = heading.take().unwrap_or((HeadingLevel::H6, String::new()));
                    anchors.insert(tidy::slug(&name));
                    if level == HeadingLevel::H1 && title.is_empty() {
                        title = name;
                    }
                }
                _ => {}
            }
        }
        Self { title, anchors, text }
    }

    /// The document as HTML; `link` turns each link of the document into one of the page.
    pub fn html(&self, mut link: impl FnMut(&str) -> String) -> String {
        let mut events: Vec<Event> = Parser::new_ext(&self.text, options()).collect();
        for i in 0..events.len() {
            let anchor = matches!(events[i], Event::Start(Tag::Heading { .. })).then(|| anchor_of(&events[i + 1..]));
            match &mut events[i] {
                Event::Start(Tag::Heading { id, .. }) => *id = anchor.map(CowStr::from),
                Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                    *dest_url = link(dest_url).into();
                }
                _ => {}
            }
        }
        let mut page = String::new();
        html::push_html(&mut page, events.into_iter());
        page
    }
}

/// The anchor of a heading whose events follow.
fn anchor_of(events: &[Event]) -> String {
    let mut name = String::new();
    for event in events {
        match event {
            Event::End(TagEnd::Heading(_)) => break,
            Event::Text(part) | Event::Code(part) => name.push_str(part),
            _ => {}
        }
    }
    tidy::slug(&name)
}

fn options() -> Options {
    Options::ENABLE_TABLES | Options::ENABLE_STRIKETHROUGH
}

/// Text for HTML.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_tables_and_links_become_html() {
        let page = Page::new("# The `one`\n\nSee [b](b.md#c).\n\n| a |\n|---|\n| <b> |\n\n## Part two\n".into());
        assert_eq!(page.title, "The one");
        assert!(page.anchors.contains("part-two"), "{:?}", page.anchors);
        let html = page.html(|link| link.replace(".md", ".html"));
        for part in ["<h1 id=\"the-one\">", "<a href=\"b.html#c\">", "<td>", "<h2 id=\"part-two\">"] {
            assert!(html.contains(part), "{part}: {html}");
        }
    }
}
