//! The container: identity, every cut and every changed byte noticed, sizes bounded.

use weaver_codec::{CodecError, Container, Stream};

fn sample() -> Container<'static> {
    let stream = |name, symbols, bytes: &'static [u8]| Stream { name, symbols, bytes: bytes.into() };
    let streams =
        vec![stream(*b"posi", 300, b"some bytes"), stream(*b"none", 0, b""), stream(*b"colo", 1 << 40, &[0; 200])];
    Container { gaussians: 300, coefficients: 9, streams }
}

#[test]
fn containers_come_back() {
    let bytes = sample().write();
    assert_eq!(Container::read(&bytes).unwrap(), sample());
    assert_eq!(Container::read_start(&bytes).unwrap(), sample());
}

#[test]
fn every_cut_and_change_is_noticed() {
    let bytes = sample().write();
    for end in 0..bytes.len() {
        assert!(Container::read(&bytes[..end]).is_err(), "{end}");
        if let Ok(start) = Container::read_start(&bytes[..end]) {
            assert_eq!(start.streams, sample().streams[..start.streams.len()]);
        }
    }
    for at in 0..bytes.len() {
        for flip in [1, 0x80, 0xff] {
            let mut changed = bytes.clone();
            changed[at] ^= flip;
            assert!(Container::read(&changed).is_err(), "byte {at}");
        }
    }
    assert!(Container::read(&[&bytes[..], &[0]].concat()).is_err());
    let foreign = Container::read(b"\x89PNG\r\n").unwrap_err();
    assert!(matches!(foreign, CodecError::Foreign { .. }));
    assert_eq!(foreign.to_string(), "byte 0: expected WVSZ, found \\x89PNG");
}

#[test]
fn sizes_are_bounded_by_the_bytes() {
    let empty = |gaussians| Container { gaussians, coefficients: 1, streams: Vec::new() };
    let bytes = empty(10_000).write();
    assert_eq!(bytes.len(), 1250);
    assert_eq!(Container::read(&bytes).unwrap(), empty(10_000));
    assert!(matches!(Container::read(&bytes[..1249]), Err(CodecError::Ended { expected: 1250, .. })));
    // A bomb: the header of the same, with more Gaussians.
    let mut bomb = empty(8 * 17).write();
    let honest = bomb.len();
    assert!(honest == 17);
    bomb.truncate(13);
    assert!(Container::read(&bomb).is_err());
}
