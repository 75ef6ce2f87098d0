//! English as far as it can be counted: nouns in place of noun clauses, and comments that fit beside the code.

use super::sources::Source;

/// Folders that the rules hold for.
const FOLDERS: &[&str] = &[
    "crates/engine",
    "crates/scene",
    "crates/photos",
    "crates/fit",
    "crates/nets",
    "crates/app/cli",
    "crates/app/command",
    "crates/app/py",
    "crates/app/reconstruct",
    "crates/app/run",
    "crates/app/trainer",
    "crates/app/view-run",
    "docs",
    "methods/bench",
    "methods/compression",
    "methods/dynamic",
    "methods/image",
    "methods/lidar",
    "methods/lift",
    "methods/studies",
    "methods/two-experts",
    "methods/vad",
    "methods/wild",
    "tests",
    "xtask",
];

/// Pages made of the texts of the program, whose lines do not wrap.
const GENERATED: &[&str] = &["docs/reference/flags.md", "docs/reference/python/"];

/// Columns of a line of a comment or of Markdown.
const WIDEST: usize = 120;

/// A construction that stands where a noun belongs.
struct Construction {
    phrases: &'static [&'static [&'static str]],
    /// Occurrences in 1000 words of a folder; ordinary questions and conjunctions stay below.
    most: f64,
}

const CONSTRUCTIONS: &[Construction] = &[
    Construction { phrases: &[&["what"], &["whatever"]], most: 2.0 },
    Construction {
        phrases: &[&["that", "of"], &["those", "of"], &["of", "which"], &["the", "one", "of"], &["ones", "of"]],
        most: 0.5,
    },
];

pub fn check<'s>(sources: impl Iterator<Item = &'s Source> + Clone, faults: &mut Vec<String>) {
    for folder in FOLDERS {
        let inside = sources.clone().filter(|source| source.place.starts_with(&format!("{folder}/")));
        inside.clone().for_each(|source| check_width(source, faults));
        let words: Vec<(&str, Vec<String>)> = inside.map(|source| (source.place.as_str(), words(source))).collect();
        for construction in CONSTRUCTIONS {
            check_construction(folder, construction, &words, faults);
        }
    }
}

/// Lines end within the width. Tables, pictures and blocks of code cannot be wrapped, nor can a single long word.
fn check_width(source: &Source, faults: &mut Vec<String>) {
    if GENERATED.iter().any(|place| source.place.starts_with(place)) {
        return;
    }
    let page = source.place.ends_with(".md");
    for line in lines(source) {
        let code = page && line.whole.starts_with("    ");
        let wraps = !code && !line.text.starts_with('|') && !line.text.starts_with("![") && line.text.contains(' ');
        if wraps && line.whole.chars().count() > WIDEST {
            faults.push(format!("{}:{}: a comment of more than {WIDEST} columns", source.place, line.number));
        }
    }
}

fn check_construction(
    folder: &str,
    construction: &Construction,
    words: &[(&str, Vec<String>)],
    faults: &mut Vec<String>,
) {
    let counted: Vec<(&str, usize)> = words.iter().map(|(place, words)| (*place, construction.count(words))).collect();
    let found: usize = counted.iter().map(|(_, count)| count).sum();
    let all: usize = words.iter().map(|(_, words)| words.len()).sum();
    let share = 1000.0 * found as f64 / all.max(1) as f64;
    if share > construction.most {
        let worst = counted.iter().max_by_key(|(_, count)| *count).map_or("", |(place, _)| place);
        let name = construction.phrases[0].join(" ");
        faults.push(format!(
            "{folder}: {share:.1} times \"{name}\" and the like in 1000 words, more than {}, most of them in {worst}; \
             take the noun of the field",
            construction.most
        ));
    }
}

impl Construction {
    fn count(&self, words: &[String]) -> usize {
        self.phrases.iter().map(|phrase| words.windows(phrase.len()).filter(|found| is(found, phrase)).count()).sum()
    }
}

/// True if words are a phrase; punctuation may stand behind it and not within.
fn is(words: &[String], phrase: &[&str]) -> bool {
    let last = words.len() - 1;
    words[..last] == phrase[..last] && words[last].trim_end_matches(|c: char| !c.is_alphanumeric()) == phrase[last]
}

/// A line of a comment or of Markdown outside of blocks of code.
struct Line<'s> {
    number: usize,
    whole: &'s str,
    /// The line without indentation and the marker of a comment.
    text: &'s str,
    /// True if it is part of the documentation, false for a comment among code.
    documents: bool,
}

fn lines(source: &Source) -> Vec<Line<'_>> {
    let mut lines = Vec::new();
    let mut in_code = false;
    for (number, whole) in (1..).zip(source.text.lines()) {
        let Some((text, documents)) = comment(&source.place, whole) else {
            in_code = false;
            continue;
        };
        if text.starts_with("```") {
            in_code = !in_code;
        } else if !in_code {
            lines.push(Line { number, whole, text, documents });
        }
    }
    lines
}

/// Text of a line, and whether it documents; `None` for code, and in files of other kinds.
fn comment<'s>(place: &str, line: &'s str) -> Option<(&'s str, bool)> {
    let line = line.trim();
    if place.ends_with(".md") {
        return Some((line, true));
    }
    let line = place.ends_with(".rs").then_some(line)?;
    let (text, documents) = match line.strip_prefix("///").or_else(|| line.strip_prefix("//!")) {
        Some(text) => (text, true),
        None => (line.strip_prefix("//")?, false),
    };
    Some((text.trim_start(), documents))
}

/// Words of the documentation in a file, in lower case and without code. A word keeps the punctuation behind it.
fn words(source: &Source) -> Vec<String> {
    let documentation = lines(source).into_iter().filter(|line| line.documents);
    let text: Vec<&str> = documentation.map(|line| line.text).collect();
    // Every other part between backticks is code.
    let prose: Vec<String> = text.join(" ").split('`').step_by(2).map(str::to_lowercase).collect();
    let all = prose.iter().flat_map(|part| part.split_whitespace());
    let words = all.map(|word| word.trim_start_matches(|c: char| !c.is_alphanumeric()));
    words.filter(|word| !word.is_empty()).map(String::from).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(place: &str, text: &str) -> Source {
        Source { place: place.into(), inside: String::new(), text: text.into() }
    }

    fn faults(sources: &[Source]) -> Vec<String> {
        let mut faults = Vec::new();
        check(sources.iter(), &mut faults);
        faults
    }

    /// Clauses are counted over a folder, so that one of them passes in a long text and not in a short one.
    #[test]
    fn clauses_are_counted_in_documentation() {
        let short =
            source("crates/engine/a/src/lib.rs", "//! What is asked for.\n/// The size is that of\n/// a tile.\n");
        let found = faults(std::slice::from_ref(&short));
        assert_eq!(found.len(), 2, "{found:?}");
        assert!(found[0].starts_with("crates/engine: 90.9 times \"what\"") && found[0].contains("a/src/lib.rs"));
        let long = source("crates/engine/README.md", &"A sum of products.\n".repeat(1000));
        assert_eq!(faults(&[short, long]), [""; 0]);
    }

    #[test]
    fn code_and_comments_among_it_do_not_count() {
        let text = "/// Takes `what`:\n/// ```\n/// let what = that of;\n/// ```\nfn f() {}\n// What follows.\nlet what = 1;\n";
        assert_eq!(faults(&[source("crates/nets/a/src/lib.rs", text)]), [""; 0]);
        assert_eq!(faults(&[source("methods/a/src/lib.rs", "//! What it is.\n")]), [""; 0]);
    }

    #[test]
    fn punctuation_ends_phrases() {
        let count = |text: &str| CONSTRUCTIONS[1].count(&words(&source("a.md", text)));
        assert_eq!(
            ["(that of)", "tiles, of which, two", "That, of course", "on that: of ten"].map(count),
            [1, 1, 0, 0]
        );
    }

    #[test]
    fn comments_are_short() {
        let [long, word] = [format!("a {}", "b ".repeat(60)), "b".repeat(130)];
        let text = format!(
            "// {long}\n// {word}\n/// | {long} |\n/// ```\n/// {long}\n/// ```\nfn f() {{}} {long}\n//! {long}\n"
        );
        let expected = [1, 8].map(|line| format!("crates/fit/a/src/lib.rs:{line}: a comment of more than 120 columns"));
        assert_eq!(faults(&[source("crates/fit/a/src/lib.rs", &text)]), expected);
        let readme = source("crates/fit/a/README.md", &format!("{long}\n\n| {long}\n"));
        assert_eq!(faults(&[readme]), ["crates/fit/a/README.md:1: a comment of more than 120 columns"]);
    }
}
