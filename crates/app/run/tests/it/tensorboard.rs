use weaver_run::TensorBoard;

/// A protocol-buffer field: its number, and its content where it is delimited by a length, or its numeric value.
struct Field<'a> {
    number: u64,
    integer: u64,
    content: &'a [u8],
}

fn varint(bytes: &mut &[u8]) -> u64 {
    let mut value = 0;
    for shift in (0..).step_by(7) {
        let byte = bytes[0];
        *bytes = &bytes[1..];
        value |= u64::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            break;
        }
    }
    value
}

fn fields(mut bytes: &[u8]) -> Vec<Field<'_>> {
    let mut found = Vec::new();
    while !bytes.is_empty() {
        let key = varint(&mut bytes);
        let (mut integer, mut length) = (0, 0);
        match key & 7 {
            0 => integer = varint(&mut bytes),
            1 => length = 8,
            2 => length = varint(&mut bytes) as usize,
            5 => length = 4,
            other => panic!("wire type {other}"),
        }
        found.push(Field { number: key >> 3, integer, content: &bytes[..length] });
        bytes = &bytes[length..];
    }
    found
}

/// The events of a file, each with its step and its scalars; framing and checksums are checked on the way.
fn events(mut bytes: &[u8]) -> Vec<(u64, Vec<(String, f32)>)> {
    let mut found = Vec::new();
    while !bytes.is_empty() {
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let masked = |data: &[u8]| crc32c::crc32c(data).rotate_right(15).wrapping_add(0xa282_ead8);
        let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        assert_eq!(word(8), masked(&bytes[..8]));
        let event = &bytes[12..12 + length];
        assert_eq!(word(12 + length), masked(event));
        let event = fields(event);
        let step = event.iter().find(|f| f.number == 2).map_or(0, |f| f.integer);
        let summary = event.iter().find(|f| f.number == 5).map_or(&[][..], |f| f.content);
        let scalars = fields(summary).into_iter().map(|value| {
            let parts = fields(value.content);
            let of = |number| parts.iter().find(|f| f.number == number).unwrap().content;
            (String::from_utf8(of(1).to_vec()).unwrap(), f32::from_le_bytes(of(2).try_into().unwrap()))
        });
        found.push((step, scalars.collect()));
        bytes = &bytes[12 + length + 4..];
    }
    found
}

#[test]
fn scalars_are_in_the_event_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("new/events");
    let mut board = TensorBoard::create(&path).unwrap();
    board.scalars(1, &[("loss", 0.5), ("rate", 1e-3)]).unwrap();
    board.scalars(300, &[("loss/größe".to_string(), -2.0)]).unwrap();
    let files: Vec<_> = std::fs::read_dir(&path).unwrap().map(|e| e.unwrap()).collect();
    assert_eq!(files.len(), 1);
    assert!(files[0].file_name().to_string_lossy().starts_with("events.out.tfevents."));
    let found = events(&std::fs::read(files[0].path()).unwrap());
    let expected = [
        (0, vec![]),
        (1, vec![("loss".to_string(), 0.5), ("rate".to_string(), 1e-3)]),
        (300, vec![("loss/größe".to_string(), -2.0)]),
    ];
    assert_eq!(found, expected);
}
