//! Takes sharp frames of a clip into a folder: `frames CLIP OUT`.

use std::error::Error;
use weaver_clip::PhotoFiles;
use weaver_io::{Observe, OutputFolder};

struct Notes;

impl Observe for Notes {
    fn note(&mut self, text: &str) {
        println!("{text}");
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1);
    let (Some(clip), Some(out)) = (arguments.next(), arguments.next()) else {
        return Err("expected a clip, and a folder for the frames".into());
    };
    let paths = [clip.into()];
    let out = OutputFolder::claim(out, "frames", &paths)?;
    let photos = PhotoFiles::collect(&paths, None, &out, &mut Notes)?;
    println!("{} frames", photos.paths.len());
    Ok(())
}
