//! Every flag has one meaning: docs/reference/conventions.md lists flags of several commands with their values.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// The rows of the table of flags: the alternatives of a value, none for a switch, an empty one for an optional value.
fn table() -> BTreeMap<String, BTreeSet<String>> {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("docs/reference/conventions.md");
    let page = std::fs::read_to_string(page).unwrap();
    let rows = page.lines().filter_map(|line| line.strip_prefix("| `--"));
    let row = |row: &str| {
        let (flag, _) = row.split_once('`').unwrap();
        let (name, values) = flag.split_once(' ').unwrap_or((flag, ""));
        let values = if values.is_empty() { BTreeSet::new() } else { values.split("\\|").map(String::from).collect() };
        (name.to_string(), values)
    };
    rows.map(row).collect()
}

#[test]
fn a_flag_of_several_commands_has_one_meaning() {
    let (table, mut commands) = (table(), BTreeMap::<String, usize>::new());
    let mut faults = Vec::new();
    for flag in weaver_command::flags(&weaver_cli::program()) {
        *commands.entry(flag.name.clone()).or_default() += 1;
        let Some(known) = table.get(&flag.name) else { continue };
        let own: BTreeSet<String> = flag.value.iter().flat_map(|value| value.split('|')).map(String::from).collect();
        let is_switch = known.is_empty() || known.contains("");
        if own.is_empty() && !is_switch || !own.is_subset(known) {
            faults.push(format!(
                "{} --{}: {own:?}, and docs/reference/conventions.md says {known:?}",
                flag.command, flag.name
            ));
        }
    }
    for (name, count) in &commands {
        if *count > 1 && !table.contains_key(name) {
            faults.push(format!(
                "--{name}: {count} commands have it, and docs/reference/conventions.md does not explain it"
            ));
        }
    }
    for name in table.keys().filter(|name| commands.get(*name).copied().unwrap_or(0) < 2) {
        faults
            .push(format!("--{name}: docs/reference/conventions.md explains it, and fewer than two commands have it"));
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// The page of flags matches the program's definition. `UPDATE_PAGES=1` writes it.
#[test]
fn the_page_of_flags_is_the_programs() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("docs/reference/flags.md");
    let expected = weaver_command::reference(&weaver_cli::program());
    if std::env::var_os("UPDATE_PAGES").is_some() {
        std::fs::write(&page, &expected).unwrap();
    }
    let found = std::fs::read_to_string(&page).unwrap_or_default();
    assert!(
        found == expected,
        "docs/reference/flags.md is not what the program says: UPDATE_PAGES=1 cargo test -p weaver-tests flags"
    );
}
