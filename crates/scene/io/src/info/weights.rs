//! Descriptions of files of tensors: each tensor if there are few, else the modules found in their names.

use crate::safetensors::{Array, Mapped};
use std::collections::{BTreeMap, BTreeSet};

/// Tensors, or modules, that are listed one by one.
const SHOWN: usize = 30;

pub fn weights(weights: &Mapped) -> String {
    let values: usize = weights.iter().map(Array::len).sum();
    let size = size(weights.bytes());
    let mut lines = format!("safetensors, {} tensors, {} values, {size}", weights.iter().len(), grouped(values));
    for (key, value) in weights.metadata() {
        let short: String = value.chars().take(100).collect();
        lines += &format!("\n{key}: {short}{}", if short.len() < value.len() { "..." } else { "" });
    }
    if weights.iter().len() <= SHOWN {
        for weight in weights.iter() {
            lines += &format!("\n{} {} {:?}", weight.name(), weight.dtype(), weight.shape());
        }
        return lines;
    }
    let modules = Modules::of(weights);
    lines += &format!("\n{:<44} {:>7} {:>15}  {:<9} {:>8}", "module", "tensors", "parameters", "type", "size");
    for (name, module) in &modules.0 {
        let indent = if name.contains('\0') { "  " } else { "" };
        let name = format!("{indent}{}", name.replace('\0', ""));
        lines += &format!(
            "\n{name:<44} {:>7} {:>15}  {:<9} {:>8}",
            module.tensors,
            grouped(module.values),
            module.types.iter().cloned().collect::<Vec<_>>().join(" "),
            self::size(module.bytes)
        );
    }
    lines
}

#[derive(Default)]
struct Module {
    tensors: usize,
    values: usize,
    bytes: u64,
    types: BTreeSet<String>,
}

/// Modules and their parts by name; a part's name has a zero character at the end of its module's name.
struct Modules(BTreeMap<String, Module>);

impl Modules {
    /// At the first depth of names that separates modules, and one below, if that is not too long a list.
    fn of(weights: &Mapped) -> Self {
        let cut = |name: &str, depth: usize| -> String {
            let parts: Vec<&str> = name.split('.').collect();
            // The last part names a tensor, not a module.
            parts[..depth.min(parts.len() - 1).max(1)].join(".")
        };
        let count = |depth: usize| weights.iter().map(|w| cut(w.name(), depth)).collect::<BTreeSet<_>>().len();
        let first = (1..8).find(|depth| count(*depth) > 1).unwrap_or(1);
        let parts = count(first) + count(first + 1) <= SHOWN + count(first) && count(first + 1) > count(first);
        let mut modules: BTreeMap<String, Module> = BTreeMap::new();
        let mut add = |name: String, weight: &Array| {
            let module = modules.entry(name).or_default();
            module.tensors += 1;
            module.values += weight.len();
            module.bytes += weight.bytes() as u64;
            module.types.insert(weight.dtype());
        };
        for weight in weights.iter() {
            let (module, part) = (cut(weight.name(), first), cut(weight.name(), first + 1));
            if parts && part != module {
                add(format!("{module}\0{}", &part[module.len()..]), weight);
            }
            add(module, weight);
        }
        Self(modules)
    }
}

/// A number with its digits in groups of three.
fn grouped(n: usize) -> String {
    let digits = n.to_string();
    let groups: Vec<&str> =
        digits.as_bytes().rchunks(3).rev().map(|g| std::str::from_utf8(g).unwrap_or_default()).collect();
    groups.join(" ")
}

/// Bytes in units of a thousand.
fn size(bytes: u64) -> String {
    match bytes as f64 {
        b if b < 1e3 => format!("{b} B"),
        b if b < 1e6 => format!("{:.1} kB", b / 1e3),
        b if b < 1e9 => format!("{:.1} MB", b / 1e6),
        b => format!("{:.2} GB", b / 1e9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_readable() {
        assert_eq!([5, 1234, 1_190_952_703].map(grouped), ["5", "1 234", "1 190 952 703"]);
        assert_eq!([12, 1500, 2_950_000_000].map(size), ["12 B", "1.5 kB", "2.95 GB"]);
    }
}
