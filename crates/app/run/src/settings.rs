//! Settings with documentation, in layers: defaults < a TOML file < `key=value`.
//!
//! Settings are a struct that serde and schemars derive for: the fields are the keys, the doc comments their
//! documentation. An unknown key is refused with the nearest name there is, a wrong value with the expected one;
//! optional keys are set by name and unset by `none`. The range of a number is beside its key, as the schema has it
//! (`#[schemars(range(min = 0, max = 1))]`, `#[schemars(extend("exclusiveMinimum" = 0))]`): a number out of it, or one
//! that is not finite, is refused with both. [`resolve`] is all that most programs need; [`Layers`] is the same in
//! steps.
//!
//! Settings may hold numbers, words, paths, lists, structs, lists of structs, and enums whose variants have no fields
//! or are distinguished by a key `kind`. They may not hold maps or contain themselves.

mod error;
mod layers;
mod names;
mod ranges;
mod reference;
mod schema;

pub use error::Error;
pub use layers::{Layers, check, parse, read_table, resolve, source, to_toml};
pub use names::nearest;
pub use reference::annotate;
pub use toml::{Table, Value};

use schemars::JsonSchema;
use serde::{Serialize, de::DeserializeOwned};

/// Settings that can be resolved from layers, and explained. Every type that serde and schemars derive for is one.
pub trait Settings: Serialize + DeserializeOwned + JsonSchema + 'static {}

impl<S: Serialize + DeserializeOwned + JsonSchema + 'static> Settings for S {}
