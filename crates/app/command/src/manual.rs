//! The definition of a command line as pages of a manual, for `man`.

use clap_mangen::Man;

/// The pages of a program's manual, roff by the name of the page: the program's own first, then one for each command
/// and one for each second word.
///
/// ```
/// let program = clap::Command::new("tool").version("1.2").subcommand(clap::Command::new("fit").about("Fits"));
/// let pages = weaver_command::manual(program);
/// assert_eq!(pages.iter().map(|page| page.0.as_str()).collect::<Vec<_>>(), ["tool", "tool-fit"]);
/// assert!(pages[1].1.contains("Fits"));
/// ```
pub fn manual(program: clap::Command) -> Vec<(String, String)> {
    let mut program = program.disable_help_subcommand(true);
    program.build();
    let version = program.get_version().unwrap_or_default();
    let source = format!("{} {version}", program.get_name());
    let mut pages = Vec::new();
    add(&program, &source, &mut pages);
    pages
}

fn add(command: &clap::Command, source: &str, pages: &mut Vec<(String, String)>) {
    let name = command.get_display_name().unwrap_or_else(|| command.get_name()).to_string();
    let mut text = Vec::new();
    let man = Man::new(command.clone().disable_help_flag(true)).title(name.as_str()).source(source);
    // Nothing fails that writes to memory.
    let _ = man.render(&mut text);
    pages.push((name, String::from_utf8_lossy(&text).into_owned()));
    for inner in command.get_subcommands().filter(|inner| !inner.is_hide_set()) {
        add(inner, source, pages);
    }
}
