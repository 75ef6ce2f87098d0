//! Values of flags that are read and refused.

use std::ffi::OsString;
use weaver_cli::Request;

/// A command of these words and this last value; `Err` is the message of wrong usage.
fn parsed(line: &str, value: &str) -> Result<String, String> {
    let words = line.split(' ').chain([value]).map(OsString::from);
    Request::of_words(words).map(|request| format!("{request:?}")).map_err(|error| error.to_string())
}

#[test]
fn values_are_read_as_they_are_meant() {
    for (line, value, expected) in [
        ("splatweaver fit a --minutes", "0.5", "minutes: Some(0.5)"),
        ("splatweaver fit a --hold-out", "none", "hold_out: Some(Nothing)"),
        ("splatweaver fit a --hold-out", "8", "hold_out: Some(Every(8))"),
        ("splatweaver fit a --hold-out", "listed", "hold_out: Some(Listed)"),
        ("splatweaver infer a -o b --weights w --size", "448", "size: Some([448, 448])"),
        ("splatweaver infer a -o b --weights w --size", "448x252", "size: Some([252, 448])"),
        ("splatweaver convert a b --crop", "-1, 0,2.5,3", "Some(Sphere { center: [-1.0, 0.0, 2.5], radius: 3.0 })"),
        (
            "splatweaver convert a b --crop",
            "1,0,-3,-1,2,3",
            "crop: Some(Box { min: [-1.0, 0.0, -3.0], max: [1.0, 2.0, 3.0] })",
        ),
        ("splatweaver convert a b --keep", "1", "keep: Some(Count(1))"),
        ("splatweaver convert a b --keep", "0.25", "keep: Some(Share(0.25))"),
        ("splatweaver convert a b --keep", "1.0", "keep: Some(Share(1.0))"),
        ("splatweaver convert a b --rotate", "0,-1.5,90", "rotate: Some(Triple([0.0, -1.5, 90.0]))"),
    ] {
        let found = parsed(line, value).unwrap();
        assert!(found.contains(expected), "{line} {value}: {found}");
    }
}

#[test]
fn values_beyond_their_limits_are_refused() {
    for (line, values) in [
        ("splatweaver fit a --minutes", &["0", "-1", "NaN", "inf", "two"][..]),
        ("splatweaver fit a --hold-out", &["", "0", "1", "all", "-8", "8.5"]),
        ("splatweaver infer a -o b --weights w --size", &["", "x", "448x", "0", "-1", "4.5", "448x252x3", "99999"]),
        ("splatweaver convert a b --crop", &["", "1,2,3", "1,2,3,-1", "1,2,3,nan", "1,2,3,4,5", "a,b,c,d"]),
        ("splatweaver convert a b --keep", &["", "-1", "1.5", "nan", "half", "0", "0.0"]),
        ("splatweaver convert a b --rotate", &["1,2", "1,2,inf"]),
        ("splatweaver convert a b --scale", &["0"]),
    ] {
        for value in values {
            let refusal = parsed(line, value).expect_err(line);
            assert!(refusal.contains("error: "), "{line} {value}: {refusal}");
        }
    }
}

/// Promise (scenes): a reconstruction has the quality that its help names: five minutes, and half a minute of the
/// photos that come with the program.
#[test]
fn photos_of_ones_own_get_the_usual_quality() {
    for (line, value, quality) in [
        ("splatweaver reconstruct photos -o", "scene", "Normal"),
        ("splatweaver reconstruct photos -o scene --minutes", "3", "Normal"),
        ("splatweaver reconstruct --demo -o", "scene", "Draft"),
        ("splatweaver reconstruct --demo -o scene --quality", "fine", "Fine"),
    ] {
        let found = parsed(line, value).unwrap();
        assert!(found.contains(&format!("quality: {quality},")), "{line} {value}: {found}");
    }
}

#[test]
fn the_command_line_is_consistent() {
    weaver_cli::program().debug_assert();
}
