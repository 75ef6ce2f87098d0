//! Faults in the header of a safetensors file, in words.

use ::safetensors::SafeTensorError;

/// The fault of an incomplete file.
pub fn header_fault(error: SafeTensorError) -> String {
    use SafeTensorError as E;
    let found = match error {
        E::HeaderTooSmall => "fewer than 8 bytes",
        E::HeaderTooLarge | E::InvalidHeader(_) | E::InvalidHeaderStart | E::InvalidHeaderDeserialization(_) => {
            "a file of another kind"
        }
        E::InvalidHeaderLength => "a header that ends beyond the file: it was cut short, or is of another kind",
        E::MetadataIncompleteBuffer => "other bytes than its header tells of: it was cut short, or not copied whole",
        E::TensorInvalidInfo => "a tensor whose bytes do not fit its shape",
        other => return format!("{other:?}"),
    };
    found.into()
}
