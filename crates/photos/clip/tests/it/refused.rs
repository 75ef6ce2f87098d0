//! Clips without pictures, and an ffmpeg that lacks filters: a script stands for it, and reads clips by the installed
//! one.

use crate::drawing::{convert, encode, frames, has_ffmpeg};

/// Promise (photos): clips without a stream of pictures, or with one of none, are refused with the reason.
#[test]
fn clips_without_pictures_are_refused() {
    if !has_ffmpeg("clips_without_pictures_are_refused") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let [clip, sound, empty] = ["clip.mov", "sound.mov", "empty.mov"].map(|name| folder.path().join(name));
    encode(&[0; 64 * 64 * 3], (64, 64), "-pixel_format gbrp", "-c:v ffv1", &clip);
    convert(&clip, "-filter_complex aevalsrc=0:d=1[a] -map [a]", &sound);
    convert(&clip, "-c copy -frames:v 0", &empty);
    for (path, expected) in [(&sound, "found no pictures in it"), (&empty, "found no pictures")] {
        let error = frames(path, 5).err().unwrap().to_string();
        assert!(error.starts_with(&format!("{}: expected a clip", path.display())), "{error}");
        assert!(error.contains(expected), "{error}");
        let error = weaver_clip::info(path).unwrap_err().to_string();
        assert!(error.contains("found no pictures"), "{error}");
    }
}

#[cfg(unix)]
mod without_filters {
    use crate::colors::{encode_hdr, worst_of_pq};
    use crate::drawing::{encode, frames, has_ffmpeg, patches};
    use std::os::unix::fs::PermissionsExt;
    use std::path::Path;
    use std::process::Command;

    /// Names the clip for `of_another_process`.
    const CLIP: &str = "WEAVER_TEST_CLIP";

    /// Takes frames in a process of its own, whose PATH another test has chosen, and prints what a user is told.
    #[test]
    fn of_another_process() {
        let Some(clip) = std::env::var_os(CLIP) else { return };
        match frames(Path::new(&clip), 5) {
            Ok(found) => {
                // Of the clip in `another_filter_maps_hdr`.
                let off = worst_of_pq(&found, 0.5);
                let (notes, warnings) = (found.told.notes, found.told.warnings);
                println!("told: {notes:?} {warnings:?} off by {off:.1} {} frames", found.photos.len());
            }
            Err(error) => println!("told: {error}"),
        }
    }

    /// Lines about a clip by an ffmpeg without some filters; without any if `None`.
    fn told(clip: &Path, lacking: Option<&[&str]>) -> String {
        let bin = tempfile::tempdir().unwrap();
        let path = std::env::var_os("PATH").unwrap();
        let real =
            std::env::split_paths(&path).map(|folder| folder.join("ffmpeg")).find(|path| path.is_file()).unwrap();
        if let Some(lacking) = lacking {
            let case = |name: &&str| format!("*{name}=*) echo \"No such filter: '{name}'\" >&2; exit 1;;\n");
            let cases: String = lacking.iter().map(case).collect();
            let script = format!("#!/bin/sh\ncase \"$*\" in\n{cases}esac\nexec '{}' \"$@\"\n", real.display());
            std::fs::write(bin.path().join("ffmpeg"), script).unwrap();
            std::fs::set_permissions(bin.path().join("ffmpeg"), PermissionsExt::from_mode(0o755)).unwrap();
        }
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", "refused::without_filters::of_another_process", "--nocapture"]);
        let output = command.env("PATH", bin.path()).env(CLIP, clip).output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        text.split_once("told: ").unwrap().1.lines().next().unwrap().to_string()
    }

    /// Without zscale another filter maps HDR, which keeps what is darker than white.
    ///
    /// Promise of `hdr_clips_become_srgb`.
    #[test]
    fn another_filter_maps_hdr() {
        if !has_ffmpeg("another_filter_maps_hdr") {
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hdr.mkv");
        // White is at 0.58.
        encode_hdr(0.5, "smpte2084", &path);
        for filter in ["libplacebo", "tonemap_opencl"] {
            let lacking = ["zscale", "libplacebo", "tonemap_opencl"].into_iter().filter(|name| *name != filter);
            let text = told(&path, Some(&lacking.collect::<Vec<_>>()));
            if !text.contains(&format!("become sRGB by {filter} of ffmpeg")) {
                assert!(text.contains("look pale"), "{text}");
                println!("skipped: no ffmpeg with {filter} (another_filter_maps_hdr)");
                continue;
            }
            let off: f64 = text.split_once("off by ").unwrap().1.split(' ').next().unwrap().parse().unwrap();
            println!("{filter}: off by {off}");
            assert!(off < 10.0, "{text}");
        }
    }

    /// Promise (photos): without bwdif, yadif deinterlaces; without a filter that a clip needs its frames are as they
    /// are, and a warning says what to install.
    #[test]
    fn an_ffmpeg_that_lacks_filters_is_named() {
        if !has_ffmpeg("an_ffmpeg_that_lacks_filters_is_named") {
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let [fields, hdr, wide] = ["fields.mkv", "hdr.mkv", "wide.mkv"].map(|name| folder.path().join(name));
        let size = (224, 160);
        let raw = patches(40, size, |patch| patch.map(|value| (255.0 * value) as u8));
        encode(&raw, size, "-pixel_format yuv444p -framerate 25", "-vf tinterlace=interleave_top -c:v ffv1", &fields);
        encode_hdr(0.7, "smpte2084", &hdr);
        encode_hdr(0.9, "bt2020-10", &wide);
        let all = &["zscale", "libplacebo", "tonemap_opencl", "colorspace"];
        for (clip, lacking, expected) in [
            (&fields, Some(&["bwdif"][..]), "yadif of ffmpeg deinterlaces it"),
            (&fields, Some(&["bwdif", "yadif"]), "has neither bwdif nor yadif: what moves has combs; to install it: "),
            (&hdr, Some(all), "HDR colors (PQ) stay as they are and look pale: none of zscale and tonemap, libplacebo"),
            (&hdr, Some(all), "works in this ffmpeg; one with libzimg maps them, to install it: "),
            (&wide, Some(all), "wide colors stay as they are and look pale: none of zscale, colorspace works"),
            (&wide, Some(&["zscale"]), "become sRGB by colorspace of ffmpeg"),
            (&hdr, Some(&["showinfo"]), "expected an ffmpeg with its usual filters, found one without; "),
            (&hdr, None, "reading a clip needs the program ffmpeg, and there is none on the PATH"),
        ] {
            let text = told(clip, lacking);
            assert!(text.contains(expected), "{lacking:?}: {text}");
            // Frames are taken all the same where the clip can be read.
            let taken = lacking.is_some_and(|lacking| lacking != ["showinfo"]);
            assert_eq!(text.ends_with("5 frames"), taken, "{lacking:?}: {text}");
        }
    }
}
