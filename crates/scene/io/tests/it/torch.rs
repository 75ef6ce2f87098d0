//! PyTorch checkpoints: every kind of tensor, nothing executed, and hostile descriptions.

use proptest::prelude::*;
use std::io::Write;
use std::path::{Path, PathBuf};
use weaver_io::TorchCheckpoint;
use weaver_io::safetensors::write_weights;

fn sample() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../tests/fixtures/torch_checkpoint.ckpt")
}

/// Written by `torch.save` with an object in it that would run a command.
#[test]
fn every_tensor_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    let mut checkpoint = TorchCheckpoint::open(sample()).unwrap();
    let planned = checkpoint.tensors().unwrap();
    write_weights(&path, &Default::default(), &planned, |tensor, out| checkpoint.write(&tensor.name, out)).unwrap();
    let tensors = weaver_io::safetensors::Tensors::read(&path).unwrap();
    let names: Vec<&str> = tensors.tensors.keys().map(String::as_str).collect();
    let expected = ["a.part", "a.turned", "a.wide", "b.count", "b.half", "b.narrow", "c.empty", "c.parameter"];
    assert_eq!(names, expected);
    let wide: Vec<f32> = (0..12).map(|i| i as f32).collect();
    assert_eq!(tensors.values::<f32>("a.wide", &[3, 4]).unwrap(), wide);
    let turned: Vec<f32> = (0..12).map(|i| (i % 3 * 4 + i / 3) as f32).collect();
    assert_eq!(tensors.values::<f32>("a.turned", &[4, 3]).unwrap(), turned);
    assert_eq!(tensors.values::<f32>("a.part", &[2, 2]).unwrap(), [6.0, 7.0, 10.0, 11.0]);
    assert_eq!(*tensors.widened("b.narrow", &[3]).unwrap(), [1.5, -2.0, 0.25]);
    assert_eq!(tensors.get("b.narrow").unwrap().data.dtype(), "BF16");
    assert_eq!(*tensors.widened("b.half", &[1, 1]).unwrap(), [0.5]);
    assert_eq!(tensors.values::<i64>("b.count", &[]).unwrap(), [7]);
    assert_eq!(tensors.values::<f32>("c.parameter", &[2]).unwrap(), [3.0, 4.0]);
    assert!(checkpoint.remarks().is_empty(), "{:?}", checkpoint.remarks());
    assert!(!Path::new("/tmp/weaver-was-here").exists(), "the command was run");
}

/// A checkpoint with one tensor `w`, described by hand.
fn archive(path: &Path, length: i32, shape: [i32; 2], strides: [i32; 2], numbers: &[u8]) {
    let text = |t: &str| [b"X".as_slice(), &(t.len() as u32).to_le_bytes(), t.as_bytes()].concat();
    let number = |n: i32| [b"J".as_slice(), &n.to_le_bytes()].concat();
    let pair = |pair: [i32; 2]| [number(pair[0]), number(pair[1]), b"\x86".to_vec()].concat();
    let kind = b"ctorch\nFloatStorage\n".to_vec();
    let storage =
        [b"(".to_vec(), text("storage"), kind, text("0"), text("cpu"), number(length), b"tQ".to_vec()].concat();
    let make = b"ctorch._utils\n_rebuild_tensor_v2\n(".to_vec();
    let tensor = [make, storage, number(0), pair(shape), pair(strides), b"tR".to_vec()].concat();
    let program = [b"}".to_vec(), text("w"), tensor, b"s.".to_vec()].concat();
    let mut zip = zip::ZipWriter::new(std::fs::File::create(path).unwrap());
    let stored = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for (name, bytes) in [("model/data.pkl", &program[..]), ("model/data/0", numbers)] {
        zip.start_file(name, stored).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap();
}

/// Counts the bytes written, and the largest piece.
#[derive(Default)]
struct Pieces {
    bytes: usize,
    largest: usize,
}

impl Write for Pieces {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.bytes += bytes.len();
        self.largest = self.largest.max(bytes.len());
        Ok(bytes.len())
    }
    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn numbers_are_passed_on_as_they_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.pt");
    let side = 1 << 10;
    archive(&path, side * side, [side, side], [side, 1], &vec![1; 4 << 20]);
    let mut pieces = Pieces::default();
    TorchCheckpoint::open(&path).unwrap().write("w", &mut pieces).unwrap();
    assert!(pieces.bytes == 4 << 20 && pieces.largest <= 1 << 16, "{} in pieces of {}", pieces.bytes, pieces.largest);
}

/// A tensor that repeats its numbers is written as it is, unless a small file would fill a disk.
///
/// Promise (servers): a small PyTorch file does not ask for any number of numbers.
#[test]
fn repeated_numbers_are_bounded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("expanded.pt");
    let written = |shape| {
        archive(&path, 12, shape, [0, 1], &[0; 48]);
        let mut pieces = Pieces::default();
        TorchCheckpoint::open(&path).unwrap().write("w", &mut pieces).map(|()| pieces.bytes)
    };
    assert_eq!(written([100, 12]).unwrap(), 4800);
    let error = written([i32::MAX, 12]).unwrap_err().to_string();
    assert!(error.contains("tensor w: expected at most") && error.contains("numbers that repeat others"), "{error}");
}

/// A tensor that reaches beyond its numbers is refused.
#[test]
fn tensors_beyond_their_numbers_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("short.pt");
    let refused = |length, shape, strides| {
        archive(&path, length, shape, strides, &[0; 48]);
        let error = TorchCheckpoint::open(&path).unwrap().write("w", &mut Pieces::default()).unwrap_err().to_string();
        assert!(error.contains("tensor w reaches beyond"), "{error}");
    };
    // More than its storage has, turned or not; a storage that says more than the archive has.
    refused(12, [4, 4], [4, 1]);
    refused(12, [4, 4], [1, 4]);
    refused(16, [4, 4], [4, 1]);
    refused(16, [4, 4], [1, 4]);
}

#[test]
fn other_files_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |name: &str, bytes: &[u8], message: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let error = TorchCheckpoint::open(&path).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains(message), "{error}");
    };
    refused("legacy.pt", b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.", "PyTorch 1.6 or later");
    refused("empty.pt", b"", "PyTorch 1.6 or later");
    let whole = std::fs::read(sample()).unwrap();
    refused("cut.pt", &whole[..whole.len() / 2], "PyTorch 1.6 or later");
    // The end of central directory alone: an archive with nothing in it.
    refused("nothing.pt", &[b"PK\x05\x06".as_slice(), &[0; 18]].concat(), "data.pkl");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]

    /// With any bytes changed: an error or other tensors, but no panic and no endless memory.
    #[test]
    fn changed_bytes(changes in prop::collection::vec((0usize..1800, any::<u8>()), 1..6)) {
        let mut bytes = std::fs::read(sample()).unwrap();
        for (at, byte) in changes {
            bytes[at] = byte;
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("changed.ckpt");
        std::fs::write(&path, &bytes).unwrap();
        if let Ok(mut checkpoint) = TorchCheckpoint::open(&path) {
            for tensor in checkpoint.tensors().into_iter().flatten().filter(|t| t.bytes() < 1 << 20) {
                let _ = checkpoint.write(&tensor.name, &mut std::io::sink());
            }
        }
    }
}
