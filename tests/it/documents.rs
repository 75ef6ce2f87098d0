//! Commands in documents are accepted by the program.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use weaver_cli::Request;

#[test]
fn every_command_of_the_documents_parses() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let mut pages = vec![root.join("README.md")];
    add_pages(&root.join("docs"), &mut pages);
    let (mut faults, mut seen) = (Vec::new(), 0);
    for page in pages {
        for command in commands(&fs::read_to_string(&page).unwrap()) {
            seen += 1;
            let parsed = Request::of_words(words(&command).into_iter().map(OsString::from));
            // `--help` and `--version` are errors of clap, too.
            if let Some(error) = parsed.err().filter(|error| error.use_stderr()) {
                faults.push(format!("{}: {command}\n{error}", page.display()));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(seen > 80, "only {seen} commands were found");
}

#[test]
fn commands_are_found_in_blocks_of_sh() {
    let page =
        "```sh\n$ splatweaver a \\\n    b   # c\ncargo d\n```\n\n```text\nsplatweaver e\n```\n    splatweaver f\n";
    let found = commands(page);
    assert_eq!(found, ["splatweaver a     b   # c"]);
    assert_eq!(words(&found[0]), ["splatweaver", "a", "b"]);
    assert_eq!(
        words("splatweaver --set 'a=[\"b\", \"c\"]' d#e > f"),
        ["splatweaver", "--set", "a=[\"b\", \"c\"]", "d#e"]
    );
}

/// The Markdown files of a folder and its subfolders.
fn add_pages(folder: &Path, pages: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            add_pages(&path, pages);
        } else if path.extension().is_some_and(|extension| extension == "md") {
            pages.push(path);
        }
    }
}

/// The lines of `sh` blocks that start with `splatweaver`, after a prompt or not, with the lines that continue them.
fn commands(page: &str) -> Vec<String> {
    let (mut inside, mut open) = (false, false);
    let mut found: Vec<String> = Vec::new();
    for line in page.lines() {
        if line.starts_with("```") {
            (inside, open) = (line == "```sh", false);
            continue;
        }
        let command = line.trim_start_matches("$ ");
        let (text, continued) = command.strip_suffix('\\').map_or((command, false), |text| (text, true));
        if open {
            found.last_mut().unwrap().push_str(text);
        } else if inside && command.starts_with("splatweaver") {
            found.push(text.to_string());
        } else {
            continue;
        }
        open = continued;
    }
    found
}

/// The words of a line as a shell takes them apart, up to a comment or a redirection.
fn words(line: &str) -> Vec<String> {
    let (mut words, mut word, mut quote) = (Vec::new(), String::new(), None);
    for letter in line.chars() {
        match quote {
            Some(mark) if mark == letter => quote = None,
            Some(_) => word.push(letter),
            None if letter == '\'' || letter == '"' => quote = Some(letter),
            None if (letter == '#' || letter == '>') && word.is_empty() => break,
            None if letter == ' ' => words.extend((!word.is_empty()).then(|| std::mem::take(&mut word))),
            None => word.push(letter),
        }
    }
    words.extend((!word.is_empty()).then_some(word));
    words
}
