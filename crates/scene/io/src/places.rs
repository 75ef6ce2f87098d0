//! Tables of a user's own: positions of cameras, and ends of a scale bar.

use crate::files::file::read_text;
use crate::{Error, Result};
use csv::{ReaderBuilder, StringRecord, Trim};
use std::path::Path;
use weaver_geometry::geodesy::Geographic;
use weaver_geometry::glam::{DVec2, DVec3};

/// Names of columns, any of each.
const NAME: &[&str] = &["name", "#name", "label", "#label", "image", "photo", "file", "filename"];
const LATITUDE: &[&str] = &["latitude", "lat"];
const LONGITUDE: &[&str] = &["longitude", "lon", "long", "lng"];
const ALTITUDE: &[&str] = &["altitude", "alt", "z", "height", "elevation"];
const LOCAL: [&[&str]; 3] = [&["x", "east", "easting", "x/east"], &["y", "north", "northing", "y/north"], ALTITUDE];

/// Positions of cameras by the names of photos.
#[derive(Clone, Debug, PartialEq)]
pub enum Positions {
    /// Places on the Earth.
    Geographic(Vec<(String, Geographic)>),
    /// Meters in a frame with the axes east, north and up, as of a survey or a national grid.
    Local(Vec<(String, DVec3)>),
}

/// Reads a table of positions: a first line with the names `name,latitude,longitude,altitude` or `name,x,y,z` in any
/// order, then a line for each photo; further columns are ignored.
///
/// ```
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("positions.csv");
/// std::fs::write(&path, "name,x,y,z\na.jpg,1,2,3.5\n")?;
/// let weaver_io::Positions::Local(rows) = weaver_io::read_positions(&path)? else { panic!() };
/// assert_eq!((rows[0].0.as_str(), rows[0].1.z), ("a.jpg", 3.5));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// When the file cannot be read, a column is missing, or a number is not one.
pub fn read_positions(path: impl AsRef<Path>) -> Result<Positions> {
    let path = path.as_ref();
    let table = Table::read(path, "name,x,y,z or name,latitude,longitude,altitude")?;
    let name = table.column(NAME)?;
    if let (Ok(latitude), Ok(longitude)) = (table.column(LATITUDE), table.column(LONGITUDE)) {
        let altitude = table.column(ALTITUDE)?;
        let place = |row: &Row| {
            let latitude = row.number(latitude, Some(90.0))?;
            let place = Geographic {
                latitude,
                longitude: row.number(longitude, Some(360.0))?,
                altitude: row.number(altitude, None)?,
            };
            Ok((row.text(name).to_string(), place))
        };
        return Ok(Positions::Geographic(table.rows().map(|row| place(&row)).collect::<Result<_>>()?));
    }
    let [x, y, z] = [table.column(LOCAL[0])?, table.column(LOCAL[1])?, table.column(LOCAL[2])?];
    let place = |row: &Row| {
        let at = DVec3::new(row.number(x, None)?, row.number(y, None)?, row.number(z, None)?);
        Ok((row.text(name).to_string(), at))
    };
    Ok(Positions::Local(table.rows().map(|row| place(&row)).collect::<Result<_>>()?))
}

/// The two ends of a bar in a photo.
#[derive(Clone, Debug, PartialEq)]
pub struct BarInPhoto {
    /// The photo's name.
    pub name: String,
    /// The ends, pixels of the photo as it is shown.
    pub ends: [DVec2; 2],
    /// Its length, meters.
    pub length: f64,
}

/// Reads a table of a scale bar: a first line `name,ax,ay,bx,by,length`, then a line for each photo with the pixels of
/// both ends and the length in meters.
///
/// # Errors
/// When the file cannot be read, a column is missing, a number is not one, there are fewer than two photos, or several
/// lengths.
pub fn read_scale_bar(path: impl AsRef<Path>) -> Result<Vec<BarInPhoto>> {
    let path = path.as_ref();
    let table = Table::read(path, "name,ax,ay,bx,by,length")?;
    let name = table.column(NAME)?;
    let [ax, ay, bx, by, length] = [
        table.column(&["ax"])?,
        table.column(&["ay"])?,
        table.column(&["bx"])?,
        table.column(&["by"])?,
        table.column(&["length"])?,
    ];
    let bar = |row: &Row| {
        let number = |at| row.number(at, None);
        let ends = [DVec2::new(number(ax)?, number(ay)?), DVec2::new(number(bx)?, number(by)?)];
        Ok(BarInPhoto { name: row.text(name).to_string(), ends, length: number(length)? })
    };
    let bars: Vec<BarInPhoto> = table.rows().map(|row| bar(&row)).collect::<Result<_>>()?;
    let length = bars.first().map_or(0.0, |bar| bar.length);
    if bars.len() < 2 {
        return Err(Error::invalid(path, "photos", "two or more that show both ends of the bar", bars.len()));
    }
    if let Some(other) = bars.iter().find(|bar| bar.length != length || bar.length <= 0.0) {
        return Err(Error::invalid(
            path,
            "length",
            "one positive length in meters",
            format!("{length}, {}", other.length),
        ));
    }
    Ok(bars)
}

/// A table with the names of its columns.
struct Table<'a> {
    path: &'a Path,
    names: Vec<String>,
    expected: &'static str,
    records: Vec<StringRecord>,
}

struct Row<'a> {
    table: &'a Table<'a>,
    line: usize,
    record: &'a StringRecord,
}

impl<'a> Table<'a> {
    fn read(path: &'a Path, expected: &'static str) -> Result<Self> {
        let text = read_text(path)?;
        let first = text.lines().next().unwrap_or("");
        let delimiter = [b'\t', b';', b','].into_iter().find(|d| first.as_bytes().contains(d)).unwrap_or(b',');
        let mut reader = ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .trim(Trim::All)
            .delimiter(delimiter)
            .from_reader(text.as_bytes());
        let records = reader.records().collect::<std::result::Result<Vec<_>, _>>();
        let mut records = records.map_err(|error| Error::invalid(path, "table", expected, error))?;
        if records.is_empty() {
            return Err(Error::invalid(path, "line 1", format!("names of columns, as in {expected}"), "nothing"));
        }
        let names = records.remove(0).iter().map(|name| name.to_lowercase()).collect();
        Ok(Self { path, names, expected, records })
    }

    fn column(&self, names: &[&str]) -> Result<usize> {
        let found = self.names.iter().position(|own| names.contains(&own.as_str()));
        found.ok_or_else(|| {
            let expected = format!("names of columns, as in {}: {:?}", self.expected, names[0]);
            Error::invalid(self.path, "line 1", expected, self.names.join(","))
        })
    }

    fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        self.records.iter().zip(2..).map(|(record, line)| Row { table: self, line, record })
    }
}

impl Row<'_> {
    fn text(&self, column: usize) -> &str {
        self.record.get(column).unwrap_or("")
    }

    fn number(&self, column: usize, largest: Option<f64>) -> Result<f64> {
        let text = self.text(column);
        let number =
            text.parse().ok().filter(|x: &f64| x.is_finite() && largest.is_none_or(|largest| x.abs() <= largest));
        number.ok_or_else(|| {
            let expected = largest.map_or("a finite number".into(), |largest| format!("a number of at most {largest}"));
            let place = format!("line {}, {}", self.line, self.table.names[column]);
            Error::invalid(self.table.path, place, expected, format!("{text:?}"))
        })
    }
}
