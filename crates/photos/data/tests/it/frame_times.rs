//! Times of photos that are frames of clips.

use crate::claimed;
use crate::estimated::{SIZE, photos, told};
use weaver_data::estimate_photos;
use weaver_io::Transforms;

/// Promise of `frames_have_the_times_of_their_pictures`.
#[test]
fn cameras_of_frames_have_their_times() {
    let temporary = tempfile::tempdir().unwrap();
    let [taken, found] = ["taken", "found"].map(|name| temporary.path().join(name));
    let paths = photos(&taken, 4, SIZE);
    let mut estimated = estimate_photos(&paths, &[false; 4], &told()).unwrap();
    assert!(estimated.placed().len() >= 3, "{:?}", estimated.left_out());
    // The first is a photo of its own.
    estimated.times = paths.iter().cloned().zip([0.1, 0.35, 1.5, 2.0]).skip(1).collect();
    estimated.write(&claimed(&found)).unwrap();
    for frame in Transforms::read(found.join("transforms.json")).unwrap().frames {
        let photo = paths.iter().find(|path| path.file_name() == frame.path.file_name()).unwrap();
        assert_eq!(frame.time, estimated.times.get(photo).copied(), "{}", frame.name);
    }
}
