//! Files and folders as such: read whole, written atomically, appended to, mapped, claimed.

pub(crate) mod append;
pub(crate) mod atomic;
pub(crate) mod bytes;
pub(crate) mod checksum;
pub(crate) mod content;
pub(crate) mod exclusive;
pub(crate) mod file;
pub(crate) mod folder;
pub(crate) mod inner_folders;
pub(crate) mod inputs;
pub(crate) mod json;
pub(crate) mod mapped_file;
pub(crate) mod memory;
pub(crate) mod natural_order;
pub(crate) mod output_folder;
pub(crate) mod scratch_file;
pub(crate) mod shell;
pub(crate) mod staged;
pub(crate) mod unfinished;
pub(crate) mod written;
