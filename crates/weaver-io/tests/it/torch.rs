//! PyTorch checkpoints: every kind of tensor, nothing executed, and hostile descriptions.

use proptest::prelude::*;
use std::path::{Path, PathBuf};
use weaver_io::{TorchCheckpoint, write_weights};

fn sample() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/torch_checkpoint.ckpt")
}

/// Written by `torch.save` with an object in it that would run a command.
#[test]
fn every_tensor_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    let mut checkpoint = TorchCheckpoint::open(sample()).unwrap();
    let planned = checkpoint.tensors().unwrap();
    write_weights(&path, &Default::default(), &planned, |tensor, out| checkpoint.write(&tensor.name, out)).unwrap();
    let tensors = weaver_io::checkpoint::Tensors::read(&path).unwrap();
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
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever bytes are changed: an error or other tensors, but no panic and no endless memory.
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
