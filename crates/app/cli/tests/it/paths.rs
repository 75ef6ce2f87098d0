//! Outputs and inputs of every command line.

use clap::builder::ValueParser;
use clap::{Arg, Command};
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use weaver_cli::Request;
use weaver_command::{Output, Paths};

/// Every command that writes, with all its outputs, marked by `@`, and paths that it reads.
const LINES: [&str; 25] = [
    "reconstruct photos -o @out",
    "cameras photos --compare cameras.json -o @out",
    "fit capture -o @out",
    "fit capture --cameras cameras.json -o @out",
    "infer photos --run run --cameras cameras.json -o @out",
    "split capture --blocks 2 -o @out",
    "merge blocks -o @out.ply",
    "view scene.ply --cameras cameras.json --photos photos --html @out.html",
    "render scene.ply --cameras cameras.json -o @out --video @out.mp4 --gif @out.gif --webp @out.webp",
    "compress scene.ply --cameras cameras.json -o @out.wsz",
    "convert scene.ply other.ply @out.ply",
    "train --preset micro --data capture -o @out --trace @out.json",
    "convert-weights weights.pth -o @out.safetensors",
    "align scene.ply --photos photos --cameras cameras.json -o @out",
    "lift scene.ply --cameras cameras.json --features features -o @out.safetensors",
    "query scene.ply --lifted features --prompts weights.pth --cameras cameras.json -o @out",
    "dynamic train --data capture -o @out",
    "dynamic render --run run --cameras cameras.json -o @out --video @out.mp4",
    "dynamic prune --run run --keep 0.5 -o @out",
    "dynamic distil --run run --expert field -o @out",
    "vad train --features features --list list.txt -o @out",
    "vad eval --run run --features features --list list.txt --annotation list.txt --report @out.html",
    "vad score --run run features -o @out",
    "lidar photos -o @out",
    "mesh scene.ply --cameras cameras.json -o @out.ply",
];
/// More lines, of commands with the same kinds of outputs as commands above.
const MORE: [&str; 6] = [
    "man --out @out",
    "image fit photos -o @out",
    "image draw scene.ply -o @out.png",
    "image bench photos -o @out",
    "bench raster --workload weights.pth --dump @out.safetensors",
    "bench compress scene.ply --peer other.ply --data capture -o @out --html @out.html",
];

/// Paths of a line, with inputs in `folder`, `@` removed, and the n-th output replaced.
fn paths(line: &str, folder: &Path, replaced: Option<(usize, &Path)>) -> Result<Paths, String> {
    let mut outputs = 0;
    let word = |word: &str| match word.strip_prefix('@') {
        Some(output) => {
            outputs += 1;
            match replaced.filter(|(n, _)| *n + 1 == outputs) {
                Some((_, path)) => path.into(),
                None => folder.join(output).into(),
            }
        }
        None if folder.join(word).exists() => folder.join(word).into(),
        None => word.into(),
    };
    let words: Vec<OsString> = line.split(' ').map(word).collect();
    let request = Request::of_words(std::iter::once("splatweaver".into()).chain(words));
    request.map(|request| request.paths().clone()).map_err(|error| error.to_string())
}

/// No output of any command goes over anything that it reads, a photo in it, a device, or a link that leads
/// nowhere.
///
/// Promise (files): the type of an argument marks it as an output, and no output of any command goes over any of
/// its inputs.
#[cfg(unix)]
#[test]
fn outputs_never_go_over_inputs() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    for name in ["photos", "capture", "blocks", "features"] {
        std::fs::create_dir(folder.join(name)).unwrap();
        std::fs::write(folder.join(name).join("photo.jpg"), "a photo").unwrap();
    }
    for name in ["cameras.json", "scene.ply", "other.ply", "weights.pth", "list.txt"] {
        std::fs::write(folder.join(name), "mine").unwrap();
    }
    for ending in ["ply", "html", "mp4", "gif", "webp", "wsz", "json", "safetensors", "png"] {
        std::os::unix::fs::symlink("nowhere", folder.join(format!("dangling.{ending}"))).unwrap();
        std::os::unix::net::UnixListener::bind(folder.join(format!("socket.{ending}"))).unwrap();
    }
    for line in LINES.iter().chain(&MORE) {
        let plain = paths(line, folder, None).unwrap_or_else(|error| panic!("{line}: {error}"));
        plain.check().unwrap_or_else(|error| panic!("{line}: {error:?}"));
        assert_eq!(plain.written.len(), line.matches('@').count(), "{line}: outputs are of the type of outputs");
        for (n, output) in plain.written.iter().enumerate() {
            let mut over: Vec<PathBuf> = plain.read.iter().filter(|path| path.exists()).cloned().collect();
            over.extend(plain.read.iter().filter(|path| path.is_dir()).map(|path| path.join("photo.jpg")));
            if let Some(ending) = output.extension().and_then(|ending| ending.to_str()) {
                over.extend(["dangling", "socket"].map(|name| folder.join(format!("{name}.{ending}"))));
                // The demonstration of `lift`, and `convert` of cameras, write a folder.
                let file = !["lift ", "convert "].iter().any(|command| line.starts_with(command));
                over.extend(file.then(|| folder.to_path_buf()));
            }
            for path in over {
                let taken = paths(line, folder, Some((n, &path))).is_ok_and(|paths| paths.check().is_ok());
                assert!(!taken, "{line}: {} as output {n}", path.display());
            }
        }
    }
}

fn arguments<'a>(name: &str, command: &'a Command, found: &mut Vec<(String, &'a Arg)>) {
    found.extend(command.get_arguments().map(|argument| (name.to_string(), argument)));
    for second in command.get_subcommands() {
        arguments(format!("{name} {}", second.get_name()).trim(), second, found);
    }
}

/// Every argument that is written has the type of outputs, and every command that has one is in the table above.
///
/// Promise of `outputs_never_go_over_inputs`.
#[test]
fn outputs_have_their_type() {
    let program = weaver_cli::program();
    let mut all = Vec::new();
    arguments("", &program, &mut all);
    let written = ValueParser::from(Output::folder()).type_id();
    let mut commands = BTreeSet::new();
    for (command, argument) in all {
        let is_written = argument.get_value_parser().type_id() == written;
        let named = ["out", "to", "html", "video", "gif", "webp", "dump", "trace", "report"];
        let id = argument.get_id().as_str();
        let is_named = named.contains(&id) && argument.get_action().takes_values();
        // The photo whose light is the goal.
        let is_light = command == "infer" && id == "to";
        assert_eq!(is_written, is_named && !is_light, "{command} {id}");
        commands.extend(is_written.then_some(command));
    }
    for command in commands {
        let has = |line: &&str| line.starts_with(&format!("{command} "));
        assert!(LINES.iter().chain(&MORE).any(has), "{command}");
    }
}
