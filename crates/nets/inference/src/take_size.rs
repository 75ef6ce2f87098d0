//! The size of photos for models of any size.

use crate::{Error, Predictor};
use std::path::Path;
use weaver_io::Image;

/// The longest side that photos are shrunk to unless a call says otherwise, pixels.
const USUAL: usize = 384;

impl dyn Predictor + '_ {
    /// Lets a model of any size take photos in the proportions of this one, shrunk to within a height and width of
    /// `most`, by default 384 pixels. Other models stay as they are.
    ///
    /// # Errors
    /// When the photo cannot be read, or another model is asked for a size.
    pub fn take_size(&mut self, photo: &Path, most: Option<[usize; 2]>) -> Result<(), Error> {
        let [height, width] = self.image_size();
        match (self.resizable(), most) {
            (Some(model), most) => {
                let (width, height) = Image::dimensions(photo)?;
                model.resize(within([height, width], most.unwrap_or([USUAL; 2])));
                Ok(())
            }
            (None, None) => Ok(()),
            (None, Some([h, w])) => {
                let found = format!("{w}x{h} for one of {width}x{height}");
                Err(Error::Input(format!(
                    "size: expected a published checkpoint or a network for photos of any size, found {found}"
                )))
            }
        }
    }
}

/// A size in the same proportions that exceeds neither side of `most`, and is not larger.
fn within(size: [usize; 2], most: [usize; 2]) -> [usize; 2] {
    let factor = (0..2).map(|axis| most[axis] as f64 / size[axis].max(1) as f64).fold(1.0, f64::min);
    size.map(|side| ((side as f64 * factor).round() as usize).max(1))
}

#[cfg(test)]
mod tests {
    use super::within;

    #[test]
    fn proportions_stay() {
        assert_eq!(within([3000, 4000], [384; 2]), [288, 384]);
        assert_eq!(within([400, 300], [384; 2]), [384, 288]);
        assert_eq!(within([48, 64], [384; 2]), [48, 64]);
        assert_eq!(within([1000, 1000], [100, 384]), [100, 100]);
    }
}
