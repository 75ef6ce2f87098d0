//! A release: the wheel, the archive of the program, the sources, and what belongs beside them.
//!
//! Equal commits give equal bytes: times are the commit's, paths of this machine are left out, and archives are in
//! order.

mod archive;
mod elf;
mod licenses;
mod packages;
mod platform;
mod sbom;
mod wheel;

use crate::{
    cargo_home, tidy,
    wheel::{call, clear, venv},
};
use platform::Platform;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Tools from Python's registry, of one version each, so that a release can be made again.
const TOOLS: &[&str] = &["maturin==1.16.0", "wheel==0.45.1"];
/// Links for an old C library.
const LINKER: &[&str] = &["ziglang==0.17.1", "cargo-zigbuild==0.24.1"];
/// Shells that completions are made for, and the names of their files.
const SHELLS: &[(&str, &str)] = &[
    ("bash", "splatweaver.bash"),
    ("elvish", "splatweaver.elv"),
    ("fish", "splatweaver.fish"),
    ("powershell", "splatweaver.ps1"),
    ("zsh", "_splatweaver"),
];

/// All that the parts of a release are made of.
struct Release {
    root: PathBuf,
    /// Folder of what is made on the way.
    work: PathBuf,
    version: String,
    /// Seconds since 1970 of the commit.
    time: u64,
    platform: Platform,
    /// Interpreter with the tools.
    python: PathBuf,
}

/// Makes a release in a folder, `target/releases/VERSION` unless another is named.
pub fn run(arguments: &[String]) -> Result<(), String> {
    let root = tidy::root()?;
    let (work, platform) = (root.join("target/dist"), Platform::here()?);
    let version = tidy::version()?;
    let named = arguments.first().map(PathBuf::from);
    let out = named.unwrap_or_else(|| root.join("target/releases").join(&version));
    let tools = if platform.old_glibc() { [TOOLS, LINKER].concat() } else { TOOLS.to_vec() };
    let python = venv(&work.join("tools"), &tools)?;
    let release = Release { time: time_of_commit(&root)?, root, work, version, platform, python };
    release.build()?;
    clear(&out)?;
    create(&out)?;
    let name = format!("splatweaver-{}-{}", release.version, release.platform.name());
    let licenses = release.licenses(&out.join(format!("{name}.cdx.json")))?;
    wheel::make(&release, &licenses, &out)?;
    release.archive(&name, &licenses, &out)?;
    release.sources(&out)?;
    let sums = archive::checksums(&out)?;
    write(&out.join("SHA256SUMS"), &sums)?;
    print!("{sums}");
    for file in entries(&out)? {
        println!("{:>8.2} MB  {}", std::fs::metadata(&file).map_or(0, |file| file.len()) as f64 / 1e6, file.display());
    }
    Ok(())
}

impl Release {
    /// Compiles the program and the library of the Python package, without paths of this machine.
    fn build(&self) -> Result<(), String> {
        let registry = cargo_home().ok_or("CARGO_HOME: expected a folder, found no home")?.join("registry/src");
        let sysroot = output(Command::new("rustc").current_dir(&self.root).args(["--print", "sysroot"]))?;
        let sysroot = Path::new(sysroot.trim());
        let folders = [(self.root.as_path(), "/splatweaver"), (&registry, "/registry"), (sysroot, "/rust")];
        let flags = folders.map(|(from, to)| format!("--remap-path-prefix={}={to}", from.display()));
        let mut command = self.platform.cargo(&self.python);
        command.args(["--release", "--locked", "--package", "weaver-cli", "--package", "weaver-py", "--lib", "--bins"]);
        // Flags with spaces, as paths have them, are divided by this character.
        command.env("CARGO_ENCODED_RUSTFLAGS", flags.join("\u{1f}")).env("CARGO_TARGET_DIR", &self.work);
        command.env("CARGO_PROFILE_RELEASE_STRIP", "symbols").env("CARGO_INCREMENTAL", "0");
        call(self.dated(command.current_dir(&self.root)))
    }

    /// A command that gets the time of the commit.
    fn dated<'a>(&self, command: &'a mut Command) -> &'a mut Command {
        command.env("SOURCE_DATE_EPOCH", self.time.to_string())
    }

    /// The texts of all licenses; writes the bill of materials.
    fn licenses(&self, bill: &Path) -> Result<String, String> {
        let packages = packages::linked(&["weaver-cli", "weaver-py"], self.platform.triple())?;
        write(bill, &sbom::document(&self.version, &utc(self.time), &packages))?;
        licenses::texts(&packages, &read(&self.root.join("LICENSE"))?)
    }

    /// The program with its pages, completions and licenses.
    fn archive(&self, name: &str, licenses: &str, out: &Path) -> Result<(), String> {
        let folder = self.work.join("archive");
        clear(&folder)?;
        create(&folder.join("completions"))?;
        let program = self.platform.built(&self.work).join(self.platform.program());
        copy(&program, &folder.join(self.platform.program()))?;
        println!("{}", self.platform.checked(&program)?);
        output(Command::new(&program).arg("man").arg("--out").arg(folder.join("man/man1")))?;
        for (shell, file) in SHELLS {
            let script = output(Command::new(&program).args(["completions", shell]))?;
            write(&folder.join("completions").join(file), &script)?;
        }
        self.add_licenses(&folder, licenses)?;
        copy(&self.root.join("docs/changelog.md"), &folder.join("changelog.md"))?;
        archive::pack(&folder, name, self.time, &out.join(format!("{name}.tar.gz")))
    }

    /// Writes the license of the program, and of all that it links and shows.
    fn add_licenses(&self, folder: &Path, licenses: &str) -> Result<(), String> {
        copy(&self.root.join("LICENSE"), &folder.join("LICENSE"))?;
        write(&folder.join("THIRD-PARTY.txt"), licenses)?;
        copy(&self.root.join("crates/app/reconstruct/demo/LICENSE.txt"), &folder.join("DEMO-PHOTOS.txt"))?;
        let sysroot = output(Command::new("rustc").current_dir(&self.root).args(["--print", "sysroot"]))?;
        let standard = Path::new(sysroot.trim()).join("share/doc/rust/COPYRIGHT-library.html");
        // Toolchains without documentation lack the page.
        if standard.is_file() {
            copy(&standard, &folder.join("RUST-STANDARD-LIBRARY.html"))?;
        }
        Ok(())
    }

    /// The sources that the Python package is built from.
    fn sources(&self, out: &Path) -> Result<(), String> {
        let folder = self.work.join("sdist");
        clear(&folder)?;
        let mut command = Command::new(&self.python);
        command.current_dir(&self.root).args(["-m", "maturin", "sdist", "--out"]).arg(&folder);
        call(self.dated(&mut command))?;
        // Packed again, so that times and owners are those of the other archives.
        let packed = entries(&folder)?.pop().ok_or("maturin sdist: expected an archive, found none")?;
        let name = format!("splatweaver-{}", self.version);
        let unpacked = self.work.join("sdist-unpacked");
        clear(&unpacked)?;
        archive::unpack(&packed, &unpacked)?;
        archive::pack(&unpacked.join(&name), &name, self.time, &out.join(format!("{name}.tar.gz")))?;
        // Every manifest that another one names is there.
        let metadata = ["metadata", "--offline", "--format-version", "1"];
        output(Command::new(env!("CARGO")).current_dir(unpacked.join(&name)).args(metadata)).map(drop)
    }
}

fn time_of_commit(root: &Path) -> Result<u64, String> {
    if let Ok(given) = std::env::var("SOURCE_DATE_EPOCH") {
        return given.parse().map_err(|_| format!("SOURCE_DATE_EPOCH: expected seconds since 1970, found {given}"));
    }
    let text = output(Command::new("git").current_dir(root).args(["log", "-1", "--format=%ct"]))?;
    text.trim().parse().map_err(|_| format!("git log: expected a time, found {text}"))
}

/// A time as `2026-01-31T12:00:00Z`.
fn utc(seconds: u64) -> String {
    let (days, second) = ((seconds / 86_400) as i64, seconds % 86_400);
    // Days from 0000-03-01 in eras of 400 years, whose years begin in March.
    let shifted = days + 719_468;
    let (era, day) = (shifted / 146_097, shifted % 146_097);
    let year = (day - day / 1_460 + day / 36_524 - day / 146_096) / 365;
    let of_year = day - (365 * year + year / 4 - year / 100);
    let from_march = (5 * of_year + 2) / 153;
    let (date, month) = (of_year - (153 * from_march + 2) / 5 + 1, (from_march + 2) % 12 + 1);
    let year = year + 400 * era + i64::from(month <= 2);
    format!("{year:04}-{month:02}-{date:02}T{:02}:{:02}:{:02}Z", second / 3600, second / 60 % 60, second % 60)
}

/// The standard output of a command.
fn output(command: &mut Command) -> Result<String, String> {
    let done = command.output().map_err(|error| format!("{command:?}: {error}"))?;
    match done.status.success() {
        true => Ok(String::from_utf8_lossy(&done.stdout).into_owned()),
        false => Err(format!("{command:?} failed: {}", String::from_utf8_lossy(&done.stderr))),
    }
}

/// The entries of a folder in the order of their names.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let entries = std::fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut paths: Vec<PathBuf> = entries.filter_map(|entry| entry.ok().map(|entry| entry.path())).collect();
    paths.sort();
    Ok(paths)
}

fn create(folder: &Path) -> Result<(), String> {
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))
}

fn copy(from: &Path, to: &Path) -> Result<(), String> {
    std::fs::copy(from, to).map(drop).map_err(|error| format!("{}: {error}", from.display()))
}

fn read(path: &Path) -> Result<String, String> {
    std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    std::fs::write(path, text).map_err(|error| format!("{}: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read_by_people() {
        assert_eq!(utc(0), "1970-01-01T00:00:00Z");
        assert_eq!(utc(951_782_399), "2000-02-28T23:59:59Z");
        assert_eq!(utc(951_782_400), "2000-02-29T00:00:00Z");
        assert_eq!(utc(1_798_761_599), "2026-12-31T23:59:59Z");
    }
}
