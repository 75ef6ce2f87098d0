//! American spelling, in identifiers, keys and prose: one spelling that a search finds.

use super::sources::Source;

/// Parts of words that are spelled otherwise in American English, and how.
const PARTS: &[(&str, &str)] = &[
    ("colour", "color"),
    ("neighbour", "neighbor"),
    ("behaviour", "behavior"),
    ("favour", "favor"),
    ("honour", "honor"),
    ("labour", "labor"),
    ("flavour", "flavor"),
    ("harbour", "harbor"),
    ("centre", "center"),
    ("centring", "centering"),
    ("fibre", "fiber"),
    ("litre", "liter"),
    ("calibre", "caliber"),
    ("manoeuvre", "maneuver"),
    ("grey", "gray"),
    ("artefact", "artifact"),
    ("labell", "label"),
    ("modell", "model"),
    ("cancelled", "canceled"),
    ("cancelling", "canceling"),
    ("travell", "travel"),
    ("signall", "signal"),
    ("channell", "channel"),
    ("levelled", "leveled"),
    ("levelling", "leveling"),
    ("totalled", "totaled"),
    ("focuss", "focus"),
    ("licence", "license"),
    ("defence", "defense"),
    ("catalogue", "catalog"),
    ("analogue", "analog"),
    ("judgement", "judgment"),
    ("acknowledgement", "acknowledgment"),
    ("ageing", "aging"),
    ("aluminium", "aluminum"),
    ("sceptic", "skeptic"),
    ("orientated", "oriented"),
    ("mould", "mold"),
    ("analysing", "analyzing"),
];

/// Whole words that are spelled otherwise in American English, and how.
const WORDS: &[(&str, &str)] = &[
    ("metre", "meter"),
    ("metres", "meters"),
    ("millimetre", "millimeter"),
    ("millimetres", "millimeters"),
    ("kilometres", "kilometers"),
    ("analyse", "analyze"),
    ("analysed", "analyzed"),
    ("analyser", "analyzer"),
    ("whilst", "while"),
    ("amongst", "among"),
    ("learnt", "learned"),
    ("spelt", "spelled"),
    ("programme", "program"),
    ("programmes", "programs"),
    ("fulfil", "fulfill"),
    ("fulfils", "fulfills"),
    ("practise", "practice"),
];

/// Beginnings of verbs that end in -ize.
const VERBS: &[&str] = &[
    "author",
    "canonical",
    "categor",
    "character",
    "critic",
    "custom",
    "diagonal",
    "digit",
    "discret",
    "emphas",
    "equal",
    "factor",
    "final",
    "formal",
    "general",
    "homogen",
    "ideal",
    "initial",
    "internal",
    "linear",
    "local",
    "marginal",
    "maxim",
    "memor",
    "minim",
    "modern",
    "monomorph",
    "neutral",
    "normal",
    "optim",
    "organ",
    "orthogonal",
    "orthonormal",
    "parallel",
    "parameter",
    "parametr",
    "penal",
    "pixel",
    "polar",
    "priorit",
    "quant",
    "random",
    "raster",
    "real",
    "recogn",
    "regular",
    "sanit",
    "serial",
    "special",
    "stabil",
    "standard",
    "summar",
    "symmetr",
    "synchron",
    "synthes",
    "token",
    "triangular",
    "util",
    "vector",
    "visual",
    "voxel",
];

const ENDINGS: &[&str] = &["ise", "ised", "iser", "isers", "ising", "isation", "isations", "isable", "ises"];

/// Foreign spellings that stay: names of tensors in files of reference numbers, and of attributes of HTML.
const FOREIGN: &[&str] = &["intrinsics_normalised", "aria-labelledby"];

/// Files that have to contain forbidden words: this one, and the changelog with its renamed words.
const EXEMPT: &[&str] = &["xtask/src/tidy/spelling.rs", "docs/changelog.md"];

pub fn check(source: &Source, faults: &mut Vec<String>) {
    for word in words(&source.place) {
        if let Some(better) = american(&word) {
            faults.push(format!("{}: the name of the file: `{word}`; write `{better}`", source.place));
        }
    }
    if EXEMPT.contains(&source.place.as_str()) {
        return;
    }
    for (number, line) in source.text.lines().enumerate() {
        let line = FOREIGN.iter().fold(line.to_string(), |line, foreign| line.replace(foreign, ""));
        for word in words(&line) {
            if let Some(better) = american(&word) {
                faults.push(format!("{}:{}: `{word}`; write `{better}`", source.place, number + 1));
            }
        }
    }
}

/// The words of prose and of identifiers, in small letters: `RasterGrid` has two.
fn words(text: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut small = false;
    for character in text.chars() {
        if !character.is_alphabetic() || (small && character.is_uppercase()) {
            words.push(String::new());
        }
        if character.is_alphabetic() {
            words.last_mut().expect("never empty").extend(character.to_lowercase());
        }
        small = character.is_lowercase();
    }
    words.retain(|word| !word.is_empty());
    words
}

/// American spelling of a word, if it is spelled otherwise.
fn american(word: &str) -> Option<String> {
    if let Some((foreign, ours)) = PARTS.iter().find(|(foreign, _)| word.contains(foreign)) {
        return Some(word.replace(foreign, ours));
    }
    if let Some((_, ours)) = WORDS.iter().find(|(foreign, _)| *foreign == word) {
        return Some((*ours).into());
    }
    let ending = ENDINGS.iter().find(|ending| {
        let stem = word.strip_suffix(**ending);
        stem.is_some_and(|stem| VERBS.iter().any(|verb| stem.ends_with(verb)))
    })?;
    // Two nouns end as the verbs do.
    if matches!(word, "syntheses" | "emphases") {
        return None;
    }
    Some(format!("{}{}", word.strip_suffix(ending)?, ending.replacen("is", "iz", 1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foreign_words_are_found_and_others_are_not() {
        for (word, better) in [
            ("colours", "colors"),
            ("recentre", "recenter"),
            ("unnormalised", "unnormalized"),
            ("rasteriser", "rasterizer"),
            ("parametrisation", "parametrization"),
            ("metre", "meter"),
        ] {
            assert_eq!(american(word).as_deref(), Some(better));
        }
        for word in
            ["realistic", "precise", "noise", "synthesis", "syntheses", "analyses", "parameters", "totally", "raised"]
        {
            assert_eq!(american(word), None, "{word}");
        }
        assert_eq!(words("RasterGrid::tile_size, 3 HTTPServer"), ["raster", "grid", "tile", "size", "httpserver"]);
    }

    #[test]
    fn names_of_others_are_left_alone() {
        let mut faults = Vec::new();
        let text = "file.check(\"out.intrinsics_normalised\");\nlet colour = 1;\n";
        let source = Source { place: "xtask/x.rs".into(), inside: "x.rs".into(), text: text.into() };
        check(&source, &mut faults);
        assert_eq!(faults, ["xtask/x.rs:2: `colour`; write `color`"]);
    }
}
