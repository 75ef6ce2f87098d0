//! Bytes as text in the alphabet of base64 (RFC 4648).

const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

/// Appends bytes to text, with padding.
pub(super) fn encode(bytes: &[u8], text: &mut String) {
    for three in bytes.chunks(3) {
        let mut word = [0; 4];
        word[1..=three.len()].copy_from_slice(three);
        let word = u32::from_be_bytes(word);
        for i in 0..4 {
            let digit = ALPHABET[(word >> (18 - 6 * i)) as usize & 63];
            text.push(if i <= three.len() { digit.into() } else { '=' });
        }
    }
}

/// The bytes of a text, padded or not; none where it is not base64.
pub(super) fn decode(text: &str) -> Option<Vec<u8>> {
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let padding = text.bytes().rev().take_while(|digit| *digit == b'=').count();
    let digits = &text.as_bytes()[..text.len() - padding];
    if padding > 2 || (padding > 0 && !text.len().is_multiple_of(4)) {
        return None;
    }
    for four in digits.chunks(4) {
        let mut word = 0;
        for (i, digit) in four.iter().enumerate() {
            word |= u32::from(value(*digit)?) << (18 - 6 * i);
        }
        // Two digits are a byte, three are two; what they have beyond has to be zero.
        let [_, data @ ..] = word.to_be_bytes();
        let count = four.len() - 1;
        if count == 0 || data[count..].iter().any(|rest| *rest != 0) {
            return None;
        }
        bytes.extend(&data[..count]);
    }
    Some(bytes)
}

fn value(digit: u8) -> Option<u8> {
    Some(match digit {
        b'A'..=b'Z' => digit - b'A',
        b'a'..=b'z' => digit - b'a' + 26,
        b'0'..=b'9' => digit - b'0' + 52,
        b'+' => 62,
        b'/' => 63,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::{decode, encode};
    use base64::Engine;
    use base64::engine::general_purpose::STANDARD;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn gives_what_the_crate_gives(bytes in prop::collection::vec(any::<u8>(), 0..40), text in "[A-Za-z0-9+/]{0,12}[=-]{0,3}") {
            let mut coded = String::new();
            encode(&bytes, &mut coded);
            prop_assert_eq!(&coded, &STANDARD.encode(&bytes));
            prop_assert_eq!(decode(&coded), Some(bytes.clone()));
            // Without padding, too.
            prop_assert_eq!(decode(coded.trim_end_matches('=')), Some(bytes));
            if let Ok(bytes) = STANDARD.decode(&text) {
                prop_assert_eq!(decode(&text), Some(bytes));
            }
        }
    }

    #[test]
    fn other_text_is_refused() {
        for wrong in ["A", "AB=", "A===", "AB-C", "AB==CD==", "AB", "QUI="] {
            let fine = wrong == "QUI=";
            assert_eq!(decode(wrong).is_some(), fine, "{wrong}");
        }
    }
}
