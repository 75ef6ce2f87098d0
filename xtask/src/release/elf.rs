//! Shared libraries and symbol versions that an ELF file needs: the oldest C library that it runs with.

use std::collections::BTreeSet;

/// Needs of an ELF file of 64 bits, little endian.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Needs {
    /// Names of shared libraries.
    pub libraries: BTreeSet<String>,
    /// Versions of symbols, as `GLIBC_2.17`, each required at load time.
    pub versions: BTreeSet<String>,
}

/// Types of sections.
const DYNAMIC: u32 = 6;
const VERSION_NEEDS: u32 = 0x6fff_fffe;
/// Tag of a needed library in the dynamic section.
const NEEDED: u64 = 1;
/// Flag of a version whose absence is no fault.
const WEAK: u16 = 2;

impl Needs {
    /// Reads the needs of a file.
    pub fn of(bytes: &[u8]) -> Result<Self, String> {
        let file = File(bytes);
        if bytes.get(..6) != Some(b"\x7fELF\x02\x01") {
            return Err("expected an ELF file of 64 bits, little endian".into());
        }
        let (sections, size, count) = (file.u64(0x28)? as usize, file.u16(0x3a)? as usize, file.u16(0x3c)? as usize);
        let section = |i: usize| Section::read(&file, sections + i * size);
        let mut needs = Self::default();
        for i in 0..count {
            let at = section(i)?;
            match at.kind {
                DYNAMIC => needs.add_libraries(&file, &at, &section(at.link)?)?,
                VERSION_NEEDS => needs.add_versions(&file, &at, &section(at.link)?)?,
                _ => {}
            }
        }
        Ok(needs)
    }

    fn add_libraries(&mut self, file: &File, dynamic: &Section, names: &Section) -> Result<(), String> {
        for at in (dynamic.start..dynamic.start + dynamic.length).step_by(16) {
            if file.u64(at)? == NEEDED {
                self.libraries.insert(file.text(names.start + file.u64(at + 8)? as usize)?);
            }
        }
        Ok(())
    }

    /// A list of libraries, each with a list of versions; offsets are from the entry.
    fn add_versions(&mut self, file: &File, needs: &Section, names: &Section) -> Result<(), String> {
        let mut library = needs.start;
        for _ in 0..needs.info {
            let mut version = library + file.u32(library + 8)? as usize;
            for _ in 0..file.u16(library + 2)? {
                if file.u16(version + 4)? & WEAK == 0 {
                    self.versions.insert(file.text(names.start + file.u32(version + 8)? as usize)?);
                }
                version += file.u32(version + 12)? as usize;
            }
            library += file.u32(library + 12)? as usize;
        }
        Ok(())
    }

    /// The second number of the oldest C library, glibc 2.x, that has every version.
    pub fn glibc(&self) -> u32 {
        let minors = self.versions.iter().filter_map(|version| version.strip_prefix("GLIBC_2.")?.split('.').next());
        minors.filter_map(|minor| minor.parse().ok()).max().unwrap_or(0)
    }
}

struct Section {
    kind: u32,
    start: usize,
    length: usize,
    link: usize,
    info: u32,
}

impl Section {
    fn read(file: &File, at: usize) -> Result<Self, String> {
        Ok(Self {
            kind: file.u32(at + 4)?,
            start: file.u64(at + 0x18)? as usize,
            length: file.u64(at + 0x20)? as usize,
            link: file.u32(at + 0x28)? as usize,
            info: file.u32(at + 0x2c)?,
        })
    }
}

struct File<'a>(&'a [u8]);

impl File<'_> {
    fn part<const N: usize>(&self, at: usize) -> Result<[u8; N], String> {
        let part = at.checked_add(N).and_then(|end| self.0.get(at..end)).and_then(|part| part.try_into().ok());
        part.ok_or_else(|| format!("ELF file: ends before byte {at}"))
    }

    fn u16(&self, at: usize) -> Result<u16, String> {
        self.part(at).map(u16::from_le_bytes)
    }

    fn u32(&self, at: usize) -> Result<u32, String> {
        self.part(at).map(u32::from_le_bytes)
    }

    fn u64(&self, at: usize) -> Result<u64, String> {
        self.part(at).map(u64::from_le_bytes)
    }

    fn text(&self, at: usize) -> Result<String, String> {
        let rest = self.0.get(at..).unwrap_or_default();
        let end = rest.iter().position(|byte| *byte == 0).ok_or("ELF file: a name without an end")?;
        Ok(String::from_utf8_lossy(&rest[..end]).into_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    #[test]
    fn this_program_needs_the_c_library() {
        let program = std::fs::read(std::env::current_exe().unwrap()).unwrap();
        let needs = Needs::of(&program).unwrap();
        assert!(needs.libraries.contains("libc.so.6"), "{needs:?}");
        assert!(needs.glibc() >= 2, "{needs:?}");
        for end in (0..4096).chain([program.len() / 2, program.len() - 1]) {
            let _ = Needs::of(&program[..end]);
        }
    }

    #[test]
    fn the_newest_version_counts() {
        let versions = ["GLIBC_2.2.5", "GLIBC_2.17", "GLIBC_2.4", "GCC_3.0"].map(String::from).into();
        assert_eq!(Needs { versions, ..Needs::default() }.glibc(), 17);
        assert!(Needs::of(b"MZ").is_err());
    }
}
