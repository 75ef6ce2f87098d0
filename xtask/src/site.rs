//! The documents as a site: one HTML page for each, links checked, and the scene of the demonstration on the first.

mod page;

use crate::{
    tidy,
    wheel::{call, clear},
};
use page::{Page, escape};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The most bytes of the page with the scene.
const MOST: u64 = 3_000_000;
/// The page with the scene, beside the first one.
const SCENE: &str = "demo.html";
/// Documents outside of `docs/` that have a page.
const DOCUMENTS: &[&str] = &["README.md", "methods/README.md"];

/// Makes the site in a folder, `target/site` unless another is named. `--scene FILE.html` names the page of a scene to
/// show; without it `reconstruct --demo` makes one.
pub fn run(arguments: &[String]) -> Result<(), String> {
    let root = tidy::root()?;
    let (out, scene) = match arguments {
        [] => (root.join("target/site"), None),
        [out] => (out.into(), None),
        [flag, scene] if flag == "--scene" => (root.join("target/site"), Some(PathBuf::from(scene))),
        [out, flag, scene] if flag == "--scene" => (out.into(), Some(scene.into())),
        _ => return Err("usage: cargo xtask site [DIR] [--scene FILE.html]".into()),
    };
    let pages = pages(&root)?;
    let mut faults = Vec::new();
    let mut files = BTreeSet::new();
    let mut written = Vec::new();
    for (place, page) in &pages {
        let html = page.html(|link| resolved(&root, place, link, &pages, &mut files, &mut faults));
        written.push((place, html));
    }
    if !faults.is_empty() {
        return Err(format!("site:\n  {}", faults.join("\n  ")));
    }
    let scene = scene.map_or_else(|| demonstration(&root), Ok)?;
    let bytes = std::fs::metadata(&scene).map_err(|error| format!("{}: {error}", scene.display()))?.len();
    if bytes > MOST {
        return Err(format!("{}: expected at most {MOST} bytes, found {bytes}", scene.display()));
    }
    clear(&out)?;
    copy(&scene, &out.join(SCENE))?;
    for (place, html) in &written {
        let frame = (place.as_str() == "README.md").then_some(SCENE);
        let text = document(&pages[*place].title, html, &up(place), frame);
        let to = out.join(html_of(place));
        create_above(&to)?;
        std::fs::write(&to, text).map_err(|error| format!("{}: {error}", to.display()))?;
    }
    for file in &files {
        copy(&root.join(file), &out.join(file))?;
    }
    println!("site: {} pages, {} files, {}", written.len(), files.len() + 1, out.display());
    Ok(())
}

/// The documents by their paths.
fn pages(root: &Path) -> Result<BTreeMap<String, Page>, String> {
    let mut places: Vec<PathBuf> = DOCUMENTS.iter().map(|place| root.join(place)).collect();
    collect(&root.join("docs"), &mut places)?;
    let read = |path: PathBuf| {
        let text = std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        let place = path.strip_prefix(root).unwrap_or(&path).to_string_lossy().replace('\\', "/");
        Ok((place, Page::new(text)))
    };
    places.into_iter().map(read).collect()
}

fn collect(folder: &Path, found: &mut Vec<PathBuf>) -> Result<(), String> {
    let entries = std::fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    for path in entries.filter_map(|entry| entry.ok().map(|entry| entry.path())) {
        if path.is_dir() {
            collect(&path, found)?;
        } else if path.extension().is_some_and(|extension| extension == "md") {
            found.push(path);
        }
    }
    Ok(())
}

/// A link of a document as a link of its page. Links that lead nowhere are faults; files that are no pages come along.
fn resolved(
    root: &Path,
    place: &str,
    link: &str,
    pages: &BTreeMap<String, Page>,
    files: &mut BTreeSet<String>,
    faults: &mut Vec<String>,
) -> String {
    if link.contains("://") || link.starts_with("mailto:") {
        return link.into();
    }
    let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
    let folder = Path::new(place).parent().unwrap_or(Path::new(""));
    let plain = if path.is_empty() { place.into() } else { tidy::plain(&folder.join(path)) };
    let mut target = plain.to_string_lossy().replace('\\', "/");
    if root.join(&target).is_dir() {
        target = format!("{}/README.md", target.trim_end_matches('/'));
    }
    let anchor_of = |anchor: &str| if anchor.is_empty() { String::new() } else { format!("#{anchor}") };
    if let Some(page) = pages.get(&target) {
        if !anchor.is_empty() && !page.anchors.contains(anchor) {
            faults.push(format!("{place}: a link to {link}, which has no such heading"));
        }
        return format!("{}{}{}", up(place), html_of(&target), anchor_of(anchor));
    }
    if !root.join(&target).is_file() {
        faults.push(format!("{place}: a link to {link}, which does not exist"));
    }
    files.insert(target.clone());
    format!("{}{target}{}", up(place), anchor_of(anchor))
}

/// The way from a page to the first one's folder.
fn up(place: &str) -> String {
    "../".repeat(place.matches('/').count())
}

/// The path of a document's page.
fn html_of(place: &str) -> String {
    match place.strip_suffix("README.md") {
        Some(folder) => format!("{folder}index.html"),
        None => format!("{}.html", place.trim_end_matches(".md")),
    }
}

/// The page of the scene that `reconstruct --demo` makes.
fn demonstration(root: &Path) -> Result<PathBuf, String> {
    let folder = root.join("target/site-demo");
    clear(&folder)?;
    let mut command = Command::new(env!("CARGO"));
    command.current_dir(root).args(["run", "--release", "--locked", "--package", "weaver-cli", "--"]);
    call(command.args(["reconstruct", "--demo", "--out"]).arg(&folder))?;
    Ok(folder.join("view.html"))
}

fn document(title: &str, html: &str, up: &str, scene: Option<&str>) -> String {
    let frame = scene.map_or(String::new(), |scene| {
        let name = "A scene of fourteen photos, made by reconstruct --demo: drag to turn, scroll to come nearer";
        format!("<figure><iframe src=\"{scene}\" title=\"{name}\"></iframe><figcaption>{name}.</figcaption></figure>")
    });
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{}</title>\n\
         <style>{STYLE}</style>\n</head>\n<body>\n<nav><a href=\"{up}index.html\">SplatWeaver</a> \
         <a href=\"{up}docs/index.html\">Documents</a> <a href=\"{up}docs/changelog.html\">Changelog</a></nav>\n\
         <main>\n{frame}\n{html}</main>\n</body>\n</html>\n",
        escape(title)
    )
}

const STYLE: &str = "body{font:17px/1.55 system-ui,sans-serif;margin:0;color:#222;background:#fff}\
main,nav{max-width:52rem;margin:0 auto;padding:0 1rem}nav{padding:.8rem 1rem}nav a{margin-right:1.2rem}\
a{color:#0b62c4}img{max-width:100%}iframe{width:100%;height:26rem;border:1px solid #8886}figure{margin:0}\
figcaption{font-size:.85rem;opacity:.75}pre{overflow:auto;padding:.8rem;background:#8881;border-radius:4px}\
code{font-size:.88em}table{border-collapse:collapse;display:block;overflow-x:auto}\
td,th{border:1px solid #8885;padding:.3rem .6rem;text-align:left;vertical-align:top}\
@media(prefers-color-scheme:dark){body{color:#ddd;background:#181a1c}a{color:#7ab7ff}}";

fn create_above(path: &Path) -> Result<(), String> {
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))
}

fn copy(from: &Path, to: &Path) -> Result<(), String> {
    create_above(to)?;
    std::fs::copy(from, to).map(drop).map_err(|error| format!("{}: {error}", from.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_lead_to_pages_and_files() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let pages = [("README.md", "# One"), ("docs/README.md", "# Two\n\n## A part"), ("docs/a/b.md", "# Three")];
        let pages = pages.map(|(place, text)| (place.to_string(), Page::new(text.into()))).into();
        let (mut files, mut faults) = (BTreeSet::new(), Vec::new());
        let mut to = |place: &str, link: &str| resolved(&root, place, link, &pages, &mut files, &mut faults);
        assert_eq!(to("docs/a/b.md", "../README.md#a-part"), "../../docs/index.html#a-part");
        assert_eq!(to("README.md", "docs"), "docs/index.html");
        assert_eq!(to("docs/README.md", "#a-part"), "../docs/index.html#a-part");
        assert_eq!(to("docs/README.md", "https://a.org/b.md"), "https://a.org/b.md");
        assert_eq!(to("docs/README.md", "../Cargo.toml"), "../Cargo.toml");
        to("docs/README.md", "#no-part");
        to("README.md", "nowhere.md");
        assert_eq!(faults.len(), 2, "{faults:?}");
        assert!(files.contains("Cargo.toml"));
    }
}
