//! The models that a name selects: SplatWeaver and the models of built-in methods.

use weaver_trainer::Registry;

/// All models; a method's is one row.
pub fn registry() -> Registry {
    let registry = Registry::default();
    #[cfg(feature = "two-experts")]
    let registry = registry.with::<weaver_two_experts::TwoExpertsRecipe>();
    #[cfg(feature = "wild")]
    let registry = registry.with::<weaver_wild::WildRecipe>();
    registry
}

#[cfg(test)]
mod tests {
    use super::registry;

    #[test]
    fn models_are_found_by_name() {
        let registry = registry();
        let names: Vec<&str> = registry.iter().map(|entry| entry.name()).collect();
        let methods: [(bool, &str); 2] =
            [(cfg!(feature = "two-experts"), "two-experts"), (cfg!(feature = "wild"), "wild")];
        let expected = methods.iter().filter(|(built, _)| *built).map(|(_, name)| *name);
        assert_eq!(names, ["splatweaver"].into_iter().chain(expected).collect::<Vec<_>>());
        for entry in registry.iter() {
            for preset in entry.presets() {
                assert!(entry.annotated(preset).unwrap().contains("architecture"), "{preset}");
            }
        }
    }
}
