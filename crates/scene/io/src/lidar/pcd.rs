//! Point Cloud Library's files: ascii, binary, and binary compressed by LZF.

use crate::{Error, Result};
use std::path::Path;

/// Names of columns that hold the time of a point.
pub(super) const TIMES: [&str; 4] = ["time", "t", "timestamp", "time_stamp"];
/// The most that a byte of an LZF stream can become, and a little more.
const MOST_EXPANSION: usize = 100;

/// One column.
struct Field {
    name: String,
    /// Bytes of a number, and numbers of a point.
    size: usize,
    count: usize,
    kind: char,
}

impl Field {
    fn bytes(&self) -> usize {
        self.size * self.count
    }

    /// The first number of the field.
    fn read(&self, b: &[u8]) -> f64 {
        fn of<const N: usize>(b: &[u8]) -> [u8; N] {
            *b.first_chunk().expect("rows are cut to the sum of their sizes")
        }
        match (self.kind, self.size) {
            ('F', 4) => f32::from_le_bytes(of(b)).into(),
            ('F', _) => f64::from_le_bytes(of(b)),
            ('I', 1) => i8::from_le_bytes(of(b)).into(),
            ('I', 2) => i16::from_le_bytes(of(b)).into(),
            ('I', 4) => i32::from_le_bytes(of(b)).into(),
            ('I', _) => i64::from_le_bytes(of(b)) as f64,
            (_, 1) => b[0].into(),
            (_, 2) => u16::from_le_bytes(of(b)).into(),
            (_, 4) => u32::from_le_bytes(of(b)).into(),
            _ => u64::from_le_bytes(of(b)) as f64,
        }
    }
}

struct Header<'a> {
    fields: Vec<Field>,
    points: usize,
    data: &'a str,
    body: &'a [u8],
}

/// Points, and their times if there are any.
type Columns = (Vec<[f32; 3]>, Option<Vec<f64>>);

pub(super) fn decode(path: &Path, bytes: &[u8]) -> Result<Columns> {
    let Header { fields, points, data, body } = header(path, bytes)?;
    let place = |name: &str| fields.iter().position(|field| field.name == name);
    let xyz = ["x", "y", "z"].map(place);
    let [Some(x), Some(y), Some(z)] = xyz else {
        let found = fields.iter().map(|field| field.name.as_str()).collect::<Vec<_>>().join(" ");
        return Err(Error::invalid(path, "FIELDS", "x, y and z", found));
    };
    let time = fields.iter().position(|field| TIMES.contains(&field.name.as_str()));
    let wanted: Vec<usize> = [x, y, z].into_iter().chain(time).collect();
    let stride: usize = fields.iter().map(Field::bytes).sum();
    let columns = match data {
        "ascii" => ascii(path, body, &fields, points, &wanted)?,
        "binary" => {
            let rows = enough(path, body, points.checked_mul(stride))?;
            let column = |i: usize| -> Vec<f64> {
                let offset: usize = fields[..i].iter().map(Field::bytes).sum();
                rows.chunks_exact(stride).map(|row| fields[i].read(&row[offset..])).collect()
            };
            wanted.iter().map(|i| column(*i)).collect()
        }
        "binary_compressed" => {
            let rows = decompressed(path, body, points.checked_mul(stride))?;
            // Column behind column.
            let column = |i: usize| -> Vec<f64> {
                let offset: usize = fields[..i].iter().map(Field::bytes).sum::<usize>() * points;
                let bytes = &rows[offset..][..fields[i].bytes() * points];
                bytes.chunks_exact(fields[i].bytes()).map(|b| fields[i].read(b)).collect()
            };
            wanted.iter().map(|i| column(*i)).collect()
        }
        _ => return Err(Error::invalid(path, "DATA", "ascii, binary or binary_compressed", data)),
    };
    let points = (0..points).map(|row| [0, 1, 2].map(|k| columns[k][row] as f32)).collect();
    Ok((points, columns.into_iter().nth(3)))
}

fn header<'a>(path: &Path, bytes: &'a [u8]) -> Result<Header<'a>> {
    let (mut names, mut sizes, mut kinds) = (Vec::new(), Vec::new(), Vec::new());
    let (mut counts, mut points, mut end) = (Vec::new(), None, 0);
    loop {
        let line = bytes[end..].iter().position(|b| *b == b'\n').map(|length| &bytes[end..end + length]);
        let Some(line) = line else {
            return Err(Error::invalid(path, "header", "a line beginning with DATA", "the end of the file"));
        };
        end += line.len() + 1;
        let line = std::str::from_utf8(line).map_err(|_| Error::invalid(path, "header", "text", "other bytes"))?;
        let invalid = |expected: &str| Error::invalid(path, "header", expected, format!("{:?}", line.trim()));
        let mut words = line.split_whitespace();
        let key = words.next().unwrap_or("#");
        let sizes_of = |words: std::str::SplitWhitespace<'_>| -> Result<Vec<usize>> {
            words.map(|word| word.parse().map_err(|_| invalid("numbers"))).collect()
        };
        match key {
            "FIELDS" => names = words.map(String::from).collect(),
            "SIZE" => sizes = sizes_of(words)?,
            "TYPE" => kinds = words.filter_map(|word| word.chars().next()).collect(),
            "COUNT" => counts = sizes_of(words)?,
            "POINTS" => points = sizes_of(words)?.first().copied(),
            "DATA" => {
                let data = words.next().unwrap_or_default();
                let points = points.ok_or_else(|| invalid("a line beginning with POINTS before it"))?;
                if counts.is_empty() {
                    counts = vec![1; names.len()];
                }
                let fits = [sizes.len(), kinds.len(), counts.len()] == [names.len(); 3];
                let known = |(size, kind): (&usize, &char)| match kind {
                    'F' => [4, 8].contains(size),
                    'I' | 'U' => [1, 2, 4, 8].contains(size),
                    _ => false,
                };
                let counted = counts.iter().all(|count| (1..=1 << 16).contains(count));
                if !(fits && counted && sizes.iter().zip(&kinds).all(known)) {
                    let found = format!("{} FIELDS, SIZE {sizes:?}, TYPE {kinds:?}, COUNT {counts:?}", names.len());
                    return Err(Error::invalid(path, "header", "a SIZE, a TYPE and a COUNT for each of FIELDS", found));
                }
                let columns = names.into_iter().zip(sizes).zip(counts).zip(kinds);
                let fields = columns.map(|(((name, size), count), kind)| Field { name, size, count, kind }).collect();
                return Ok(Header { fields, points, data, body: &bytes[end..] });
            }
            _ => {}
        }
    }
}

/// The first `expected` bytes.
fn enough<'a>(path: &Path, body: &'a [u8], expected: Option<usize>) -> Result<&'a [u8]> {
    expected.and_then(|length| body.get(..length)).ok_or_else(|| {
        let expected = expected.map_or("fewer points".into(), |length| format!("{length} bytes of points"));
        Error::invalid(path, "body", expected, format!("{} bytes", body.len()))
    })
}

fn ascii(path: &Path, body: &[u8], fields: &[Field], points: usize, wanted: &[usize]) -> Result<Vec<Vec<f64>>> {
    let text = std::str::from_utf8(body).map_err(|_| Error::invalid(path, "body", "ASCII text", "other bytes"))?;
    let mut columns = vec![Vec::new(); wanted.len()];
    let lines = text.lines().filter(|line| !line.trim().is_empty());
    let mut rows = 0;
    for (row, line) in lines.take(points).enumerate() {
        let words: Vec<&str> = line.split_whitespace().collect();
        for (column, i) in columns.iter_mut().zip(wanted) {
            let at: usize = fields[..*i].iter().map(|field| field.count).sum();
            let number = words.get(at).and_then(|word| word.parse().ok());
            let name = &fields[*i].name;
            let invalid = || Error::invalid(path, format!("point {row}, {name}"), "a number", format!("{line:?}"));
            column.push(number.ok_or_else(invalid)?);
        }
        rows += 1;
    }
    match rows == points {
        true => Ok(columns),
        false => Err(Error::invalid(path, "body", format!("{points} points"), rows)),
    }
}

/// Two sizes, and a stream of LZF: runs of bytes, and copies of earlier bytes.
fn decompressed(path: &Path, body: &[u8], expected: Option<usize>) -> Result<Vec<u8>> {
    let broken = |found: String| Error::invalid(path, "body", "points compressed by LZF", found);
    let size = |at: usize| {
        let bytes = body.get(at..at + 4).and_then(|bytes| bytes.first_chunk());
        bytes.map(|bytes| u32::from_le_bytes(*bytes) as usize).ok_or_else(|| broken(format!("{} bytes", body.len())))
    };
    let (compressed, length) = (size(0)?, size(4)?);
    let stream = body.get(8..).and_then(|rest| rest.get(..compressed));
    let stream = stream.ok_or_else(|| broken(format!("{} bytes, fewer than it says", body.len())))?;
    if Some(length) != expected || length > compressed.saturating_mul(MOST_EXPANSION) {
        return Err(broken(format!("{compressed} bytes that become {length}")));
    }
    let mut out = Vec::with_capacity(length);
    let mut bytes = stream.iter().copied();
    let ends = || broken("a stream that ends too early".into());
    while let Some(control) = bytes.next() {
        let control = usize::from(control);
        if control < 32 {
            for _ in 0..=control {
                out.push(bytes.next().ok_or_else(ends)?);
            }
        } else {
            let mut run = control >> 5;
            if run == 7 {
                run += usize::from(bytes.next().ok_or_else(ends)?);
            }
            let back = ((control & 31) << 8) + usize::from(bytes.next().ok_or_else(ends)?) + 1;
            let start = out.len().checked_sub(back).ok_or_else(|| broken("a copy from before the beginning".into()))?;
            (start..start + run + 2).for_each(|i| out.push(out[i]));
        }
        if out.len() > length {
            return Err(broken(format!("more than {length} bytes")));
        }
    }
    if out.len() == length { Ok(out) } else { Err(broken(format!("{} bytes of {length}", out.len()))) }
}
