//! Notes on a scene.

use serde_json::{Map, Value};

/// Notes on a scene that are made in its page: the meters of a unit, the up axis, measured lengths, viewpoints with
/// titles and texts, and the keys of a camera path.
///
/// They are a JSON object:
///
/// | key | content |
/// |---|---|
/// | `meters` | meters of a unit of the scene, a positive number |
/// | `up` | the up axis, three numbers |
/// | `lengths` | pairs of points |
/// | `views` | `title`, `text` and `view` of viewpoints |
/// | `keys` | `view` of keyframes, and `seconds` to the next one |
///
/// A `view` has ten numbers with commas between: eye, target, up, and the focal length in widths of the picture. Every
/// key may be missing; others are kept.
///
/// ```
/// use weaver_view::Notes;
/// let notes = Notes::parse(r#"{"meters": 0.42, "lengths": [[[0, 0, 0], [1, 0, 0]]]}"#)?;
/// assert_eq!(notes.meters(), Some(0.42));
/// let refused = Notes::parse(r#"{"meters": -1}"#).unwrap_err().to_string();
/// assert_eq!(refused, "meters: expected a positive number, found -1");
/// # Ok::<(), weaver_view::InvalidNotes>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Notes(Map<String, Value>);

/// Text that is not [`Notes`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{place}: expected {expected}, found {found}")]
pub struct InvalidNotes {
    /// The key, as `views[2]`.
    pub place: String,
    /// The expected value.
    pub expected: &'static str,
    /// The value found.
    pub found: String,
}

impl Notes {
    /// Reads notes.
    ///
    /// # Errors
    /// When the text is not JSON, or a value is not as it must be.
    pub fn parse(text: &str) -> Result<Self, InvalidNotes> {
        let invalid = |place: &str, expected, found: &dyn ToString| InvalidNotes {
            place: place.into(),
            expected,
            found: found.to_string().chars().take(80).collect(),
        };
        let value: Value = serde_json::from_str(text).map_err(|error| invalid("notes", "JSON", &error))?;
        let Value::Object(notes) = value else { return Err(invalid("notes", "an object", &value)) };
        let given = |key: &str| notes.get(key).filter(|value| !value.is_null());
        if let Some(meters) = given("meters").filter(|meters| !meters.as_f64().is_some_and(|x| x > 0.0)) {
            return Err(invalid("meters", "a positive number", meters));
        }
        let is_axis = |up: &Value| is_point(up) && numbers(up).is_some_and(|up| up.iter().any(|x| *x != 0.0));
        if let Some(up) = given("up").filter(|up| !is_axis(up)) {
            return Err(invalid("up", "three numbers that are not all 0", up));
        }
        for (key, expected, is_entry) in LISTS {
            let Some(list) = given(key) else { continue };
            let list = list.as_array().ok_or_else(|| invalid(key, "a list", list))?;
            if let Some((i, entry)) = list.iter().enumerate().find(|(_, entry)| !is_entry(entry)) {
                return Err(invalid(&format!("{key}[{i}]"), expected, entry));
            }
        }
        Ok(Self(notes))
    }

    /// Meters of a unit of the scene.
    pub fn meters(&self) -> Option<f64> {
        self.0.get("meters").and_then(Value::as_f64)
    }

    /// True if there are no notes.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The part that holds in another frame of the same unit: `meters` alone.
    pub fn turned(&self) -> Self {
        Self(
            self.0
                .iter()
                .filter(|(key, _)| *key == "meters")
                .map(|(key, value)| (key.clone(), value.clone()))
                .collect(),
        )
    }

    /// The notes but for `meters`, as scripts take them.
    pub(crate) fn json(&self) -> Value {
        Value::Object(self.0.iter().filter(|(key, _)| *key != "meters").map(|(k, v)| (k.clone(), v.clone())).collect())
    }

    /// The notes as JSON for people.
    pub fn to_text(&self) -> String {
        format!("{:#}\n", Value::Object(self.0.clone()))
    }
}

/// Keys of lists, the expected entries, and a test of them.
type List = (&'static str, &'static str, fn(&Value) -> bool);
const LISTS: [List; 3] = [
    ("lengths", "two points", |entry| {
        entry.as_array().is_some_and(|ends| ends.len() == 2 && ends.iter().all(is_point))
    }),
    ("views", "title, text and view", |entry| {
        ["title", "text"].iter().all(|key| entry.get(key).is_some_and(Value::is_string)) && has_view(entry)
    }),
    ("keys", "a view and positive seconds", |entry| {
        has_view(entry) && entry.get("seconds").and_then(Value::as_f64).is_some_and(|seconds| seconds > 0.0)
    }),
];

fn numbers(value: &Value) -> Option<Vec<f64>> {
    value.as_array()?.iter().map(Value::as_f64).collect()
}

fn is_point(value: &Value) -> bool {
    numbers(value).is_some_and(|point| point.len() == 3)
}

fn has_view(entry: &Value) -> bool {
    let parts = |view: &str| {
        view.split(',').map(|x| x.parse().ok().filter(|x: &f64| x.is_finite())).collect::<Option<Vec<_>>>()
    };
    entry.get("view").and_then(Value::as_str).and_then(parts).is_some_and(|view| view.len() == 10)
}

#[cfg(test)]
mod tests {
    use super::*;

    const VIEW: &str = "0,0,-3,0,0,0,0,-1,0,0.9";

    #[test]
    fn notes_are_written_as_they_were_read() {
        let text = format!(
            r#"{{"up":[0,-1,0.1],"meters":2,"views":[{{"title":"a","text":"<b>","view":"{VIEW}"}}],"keys":[{{"view":"{VIEW}","seconds":1.5}}],"mine":1}}"#
        );
        let notes = Notes::parse(&text).unwrap();
        assert_eq!(Notes::parse(&notes.to_text()).unwrap(), notes);
        assert_eq!(notes.turned().to_text(), "{\n  \"meters\": 2\n}\n");
        assert!(notes.json().get("meters").is_none() && notes.json()["mine"] == 1);
        assert!(Notes::parse("{}").unwrap().is_empty());
    }

    #[test]
    fn other_values_are_named() {
        for (text, said) in [
            ("[]", "notes: expected an object, found []"),
            (r#"{"meters": 0}"#, "meters: expected a positive number, found 0"),
            (r#"{"up": [0, 0, 0]}"#, "up: expected three numbers that are not all 0, found [0,0,0]"),
            (r#"{"lengths": {}}"#, "lengths: expected a list, found {}"),
            (r#"{"lengths": [[[0,0,0],[1,0]]]}"#, "lengths[0]: expected two points, found [[0,0,0],[1,0]]"),
            (r#"{"views": [{"title": "a"}]}"#, r#"views[0]: expected title, text and view, found {"title":"a"}"#),
        ] {
            assert_eq!(Notes::parse(text).unwrap_err().to_string(), said);
        }
        let keys = |seconds: &str, view: &str| {
            Notes::parse(&format!(r#"{{"keys":[{{"view":"{view}","seconds":{seconds}}}]}}"#))
        };
        assert!(keys("1", VIEW).is_ok() && keys("0", VIEW).is_err() && keys("1", "0,0").is_err());
        assert!(keys("1", &VIEW.replace("-3", "NaN")).is_err());
        assert!(Notes::parse("{\"meters\": NaN}").unwrap_err().to_string().starts_with("notes: expected JSON, found "));
    }
}
