//! The system that a release is for.

use super::elf::Needs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The second number of the oldest glibc, 2.17 of 2012: the oldest that Rust's own library runs with.
const GLIBC: u32 = 17;

/// Libraries of the system that a wheel for many Linux systems may need.
const LIBRARIES: &[&str] =
    &["libc.so.6", "libdl.so.2", "libgcc_s.so.1", "libm.so.6", "libpthread.so.0", "librt.so.1", "libutil.so.1"];

/// Processor and operating system.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Platform {
    /// Linux with glibc.
    Linux(Processor),
    Mac(Processor),
    Windows(Processor),
}

/// Kind of processor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Processor {
    X86,
    Arm,
}

impl Platform {
    /// The platform of this program.
    pub fn here() -> Result<Self, String> {
        let processor = match std::env::consts::ARCH {
            "x86_64" => Processor::X86,
            "aarch64" => Processor::Arm,
            other => return Err(format!("release: expected a processor x86_64 or aarch64, found {other}")),
        };
        match std::env::consts::OS {
            "linux" if cfg!(target_env = "gnu") => Ok(Self::Linux(processor)),
            "macos" => Ok(Self::Mac(processor)),
            "windows" => Ok(Self::Windows(processor)),
            other => Err(format!("release: expected Linux with glibc, macOS or Windows, found {other}")),
        }
    }

    /// True if a program is linked for an older C library than this system's.
    pub fn old_glibc(self) -> bool {
        matches!(self, Self::Linux(_))
    }

    /// The name in the names of archives.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linux(Processor::X86) => "linux-x86_64",
            Self::Linux(Processor::Arm) => "linux-aarch64",
            Self::Mac(Processor::X86) => "macos-x86_64",
            Self::Mac(Processor::Arm) => "macos-arm64",
            Self::Windows(Processor::X86) => "windows-x86_64",
            Self::Windows(Processor::Arm) => "windows-arm64",
        }
    }

    /// The target of the compiler.
    pub fn triple(self) -> &'static str {
        match self {
            Self::Linux(Processor::X86) => "x86_64-unknown-linux-gnu",
            Self::Linux(Processor::Arm) => "aarch64-unknown-linux-gnu",
            Self::Mac(Processor::X86) => "x86_64-apple-darwin",
            Self::Mac(Processor::Arm) => "aarch64-apple-darwin",
            Self::Windows(Processor::X86) => "x86_64-pc-windows-msvc",
            Self::Windows(Processor::Arm) => "aarch64-pc-windows-msvc",
        }
    }

    /// The command that builds for this platform, to which packages are to be added.
    pub fn cargo(self, python: &Path) -> Command {
        if !self.old_glibc() {
            let mut cargo = Command::new(env!("CARGO"));
            cargo.args(["build", "--target", self.triple()]);
            return cargo;
        }
        let tools = python.parent().unwrap_or(Path::new(""));
        let mut cargo = Command::new(tools.join("cargo-zigbuild"));
        cargo.args(["zigbuild", "--target", &format!("{}.2.{GLIBC}", self.triple())]);
        // The linker is a package of Python beside this one.
        let path = std::env::var_os("PATH").unwrap_or_default();
        let paths = std::iter::once(tools.to_path_buf()).chain(std::env::split_paths(&path));
        if let Ok(paths) = std::env::join_paths(paths) {
            cargo.env("PATH", paths);
        }
        cargo
    }

    /// The folder that cargo builds in.
    pub fn built(self, work: &Path) -> PathBuf {
        work.join(self.triple()).join("release")
    }

    /// File name of the program.
    pub fn program(self) -> &'static str {
        if matches!(self, Self::Windows(_)) { "splatweaver.exe" } else { "splatweaver" }
    }

    /// File names of the library of the Python package: as it is built, and as Python imports it.
    pub fn extension(self) -> (&'static str, &'static str) {
        match self {
            Self::Linux(_) => ("lib_splatweaver.so", "_splatweaver.abi3.so"),
            Self::Mac(_) => ("lib_splatweaver.dylib", "_splatweaver.abi3.so"),
            Self::Windows(_) => ("_splatweaver.dll", "_splatweaver.pyd"),
        }
    }

    /// The tags of a wheel with this library: on Linux, of the oldest system that has all that the library needs.
    pub fn tags(self, library: &Path) -> Result<Vec<String>, String> {
        Ok(match self {
            Self::Linux(processor) => linux_tags(needs(library)?.glibc(), processor),
            // The oldest system that the compiler builds for by default.
            Self::Mac(Processor::X86) => vec!["macosx_10_12_x86_64".into()],
            Self::Mac(Processor::Arm) => vec!["macosx_11_0_arm64".into()],
            Self::Windows(Processor::X86) => vec!["win_amd64".into()],
            Self::Windows(Processor::Arm) => vec!["win_arm64".into()],
        })
    }

    /// A line about what a program needs of a system.
    ///
    /// # Errors
    /// A program for Linux that needs a newer C library than promised.
    pub fn checked(self, program: &Path) -> Result<String, String> {
        if !self.old_glibc() {
            return Ok(format!("{}: for this system", program.display()));
        }
        let (glibc, name) = (needs(program)?.glibc(), program.display());
        match glibc <= GLIBC {
            true => Ok(format!("{name}: needs glibc 2.{glibc}, as on any Linux since 2012")),
            false => Err(format!("{name}: expected symbols of glibc 2.{GLIBC} at most, found 2.{glibc}")),
        }
    }
}

/// The tags for Linux with glibc 2.x and newer; of 2.17, also the name that older installers know.
fn linux_tags(glibc: u32, processor: Processor) -> Vec<String> {
    let (glibc, processor) = (glibc.max(GLIBC), if processor == Processor::X86 { "x86_64" } else { "aarch64" });
    let older = (glibc == GLIBC).then(|| format!("manylinux2014_{processor}"));
    std::iter::once(format!("manylinux_2_{glibc}_{processor}")).chain(older).collect()
}

/// The needs of a file, which are only libraries of the system.
fn needs(path: &Path) -> Result<Needs, String> {
    let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let needs = Needs::of(&bytes).map_err(|error| format!("{}: {error}", path.display()))?;
    let known = |name: &&String| LIBRARIES.contains(&name.as_str()) || name.starts_with("ld-linux");
    match needs.libraries.iter().find(|name| !known(name)) {
        Some(name) => Err(format!("{}: expected libraries of the system alone, found {name}", path.display())),
        None => Ok(needs),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tags_follow_from_the_c_library() {
        let older = ["manylinux_2_17_x86_64", "manylinux2014_x86_64"];
        assert_eq!(linux_tags(14, Processor::X86), older);
        assert_eq!(linux_tags(17, Processor::X86), older);
        assert_eq!(linux_tags(28, Processor::Arm), ["manylinux_2_28_aarch64"]);
    }
}
