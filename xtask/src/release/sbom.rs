//! The packages that a release links, as a CycloneDX document.

use super::packages::{Key, Package};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The bill of materials of a release, JSON of CycloneDX 1.5 with a component for each package. It has no serial number
/// and the time of the commit, so that equal releases have equal bytes.
pub fn document(version: &str, time: &str, packages: &BTreeMap<Key, Package>) -> String {
    let components: Vec<Value> = packages.values().map(component).collect();
    let dependencies: Vec<Value> = packages
        .values()
        .map(|package| {
            let uses: Vec<String> = package.uses.iter().map(|(name, version)| reference(name, version)).collect();
            json!({ "ref": reference(&package.name, &package.version), "dependsOn": uses })
        })
        .collect();
    let document = json!({
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {
            "timestamp": time,
            "component": { "type": "application", "name": "splatweaver", "version": version, "bom-ref": "splatweaver" },
        },
        "components": components,
        "dependencies": dependencies,
    });
    format!("{document:#}\n")
}

fn component(package: &Package) -> Value {
    let reference = reference(&package.name, &package.version);
    let mut component = json!({
        "type": "library",
        "bom-ref": reference,
        "name": package.name,
        "version": package.version,
        "description": package.description,
        "purl": reference,
        // Slashes are the older form of OR.
        "licenses": [{ "expression": package.license.replace('/', " OR ") }],
    });
    if !package.checksum.is_empty() {
        component["hashes"] = json!([{ "alg": "SHA-256", "content": package.checksum }]);
    }
    if !package.repository.is_empty() {
        component["externalReferences"] = json!([{ "type": "vcs", "url": package.repository }]);
    }
    component
}

/// The address of a package, by which the document refers to it.
fn reference(name: &str, version: &str) -> String {
    format!("pkg:cargo/{name}@{}", version.replace('+', "%2B"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packages_are_components_with_edges() {
        let package = |name: &str, uses: &[&str]| {
            let uses = uses.iter().map(|name| (name.to_string(), "1.0.0+a".to_string())).collect();
            let (name, version) = (name.to_string(), "1.0.0+a".to_string());
            let license = "MIT/Apache-2.0".into();
            ((name.clone(), version.clone()), Package { name, version, license, uses, ..Package::default() })
        };
        let packages = [package("a", &["b"]), package("b", &[])].into();
        let document: Value = serde_json::from_str(&document("0.3.0", "2026-01-01T00:00:00Z", &packages)).unwrap();
        assert_eq!(document["components"][0]["licenses"][0]["expression"], "MIT OR Apache-2.0");
        assert_eq!(document["components"][1]["purl"], "pkg:cargo/b@1.0.0%2Ba");
        assert_eq!(document["dependencies"][0]["dependsOn"], json!(["pkg:cargo/b@1.0.0%2Ba"]));
    }
}
