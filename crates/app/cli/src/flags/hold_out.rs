//! The choice of held-out photos: `--hold-out listed|none|N`.

use weaver_data::capture::HoldOut;

/// `listed`, `none`, or a number N for every N-th photo.
pub fn hold_out(text: &str) -> Result<HoldOut, String> {
    match (text, text.parse()) {
        ("listed", _) => Ok(HoldOut::Listed),
        ("none", _) => Ok(HoldOut::Nothing),
        (_, Ok(step)) if (2..=1000).contains(&step) => Ok(HoldOut::Every(step)),
        _ => Err("expected listed, none or a number from 2 to 1000, as in 8".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_a_word_or_a_number() {
        assert_eq!((hold_out("none"), hold_out("8")), (Ok(HoldOut::Nothing), Ok(HoldOut::Every(8))));
        assert_eq!(hold_out("listed"), Ok(HoldOut::Listed));
        assert!(["", "0", "1", "all", "-8", "8.5"].iter().all(|text| hold_out(text).is_err()));
    }
}
