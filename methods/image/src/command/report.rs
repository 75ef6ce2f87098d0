//! Pages: of a run, and of a comparison.

use crate::command::measure::Measured;
use crate::command::others::Codec;
use crate::command::results::Row;
use crate::decode;
use weaver_command::Failure;
use weaver_io::{Image, PhotoFile, read_bytes};
use weaver_run::{Folder, Page};

/// Titles of curves in place of the log's keys.
pub const CURVES: [(&str, &str); 1] = [("gaussians", "Gaussians")];
/// Sides of crops side by side.
const SIDE: usize = 256;
/// Sides of crops in a comparison by a slider.
const COMPARED: usize = 512;

/// The page of a run: a table, and for each picture a crop in comparison with its file's drawing.
pub fn of_run(rows: &[Row], folder: &Folder) -> Result<Page, Failure> {
    let mut page = Page::new("Pictures as Gaussians");
    page.heading(1, "Pictures as Gaussians");
    let cells: Vec<Vec<String>> = rows.iter().map(cells).collect();
    page.table(&["picture", "size", "Gaussians", "bytes", "bits a pixel", "PSNR", "MS-SSIM"], &cells);
    for row in rows {
        let stem = row.picture.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let coded = decode(&read_bytes(folder.path().join(format!("{stem}.wgi")))?)?;
        let drawn = coded.fitted.draw(row.width, row.height)?;
        let photo = PhotoFile::at(&row.picture)?.over([0.0; 3]).read()?.to_image();
        let drawn = Image { width: row.width, height: row.height, pixels: drawn };
        page.heading(2, &stem);
        let [photo, drawn] = [&photo, &drawn].map(|image| middle(image, COMPARED));
        page.comparison(&stem, [("picture", &photo), ("Gaussians", &drawn)])?;
    }
    page.curves(&folder.records()?, &CURVES);
    Ok(page)
}

fn cells(row: &Row) -> Vec<String> {
    vec![
        row.picture.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        format!("{} x {}", row.width, row.height),
        row.gaussians.to_string(),
        row.bytes.to_string(),
        format!("{:.3}", row.bits_per_pixel()),
        format!("{:.2}", row.psnr),
        row.ms_ssim.map_or("-".into(), |x| format!("{x:.3}")),
    ]
}

/// The middle of a picture.
fn middle(image: &Image, side: usize) -> Image {
    let [width, height] = [image.width, image.height].map(|whole| whole.min(side));
    image.crop((image.width - width) / 2, (image.height - height) / 2, width, height)
}

/// Adds a picture to the page of a comparison: figures at equal bytes, a curve, and crops.
pub fn add(page: &mut Page, name: &str, photo: &Image, measured: &[Measured], codecs: &[Codec]) -> Result<(), Failure> {
    page.heading(2, name);
    let mut header = vec!["ratio", "bytes", "bits a pixel", "PSNR", "MS-SSIM"];
    codecs.iter().for_each(|codec| header.push(&codec.name));
    let rows: Vec<Vec<String>> = measured
        .iter()
        .map(|at| {
            let mut cells = vec![format!("{}", at.ratio)];
            cells.extend(cells_of_file(&at.judged.row));
            cells.extend(codecs.iter().map(|codec| beside(codec, at.judged.row.bytes)));
            cells
        })
        .collect();
    page.table(&header, &rows);
    let pixels = (photo.width * photo.height) as f64;
    let bits = |bytes: usize| 8.0 * bytes as f64 / pixels;
    let own: Vec<(f64, f64)> = measured.iter().map(|at| (bits(at.judged.row.bytes), at.judged.row.psnr)).collect();
    let most = 1.5 * own.iter().map(|point| point.0).fold(0.0, f64::max);
    let mut lines = vec![("Gaussians", own)];
    for codec in codecs {
        let points = codec.files.iter().map(|file| (bits(file.bytes), file.psnr)).filter(|point| point.0 <= most);
        lines.push((&codec.name, points.collect()));
    }
    page.lines("PSNR in dB over bits a pixel", &lines);
    page.picture("picture", &middle(photo, SIDE));
    for at in measured {
        let (bytes, psnr) = (at.judged.row.bytes, at.judged.row.psnr);
        let drawn = Image { width: photo.width, height: photo.height, pixels: at.judged.drawn.clone() };
        page.picture(&format!("Gaussians, {bytes} bytes, {psnr:.2} dB"), &middle(&drawn, SIDE));
        for codec in codecs {
            if let Some(file) = codec.within(bytes) {
                let caption = format!("{}, {} bytes, {:.2} dB", codec.name, file.bytes, file.psnr);
                page.picture(&caption, &middle(&file.image()?, SIDE));
            }
        }
    }
    Ok(())
}

fn cells_of_file(row: &Row) -> Vec<String> {
    let similar = row.ms_ssim.map_or("-".into(), |x| format!("{x:.3}"));
    vec![row.bytes.to_string(), format!("{:.3}", row.bits_per_pixel()), format!("{:.2}", row.psnr), similar]
}

/// Decibels and similarity of a codec at a number of bytes.
pub fn beside(codec: &Codec, bytes: usize) -> String {
    match (codec.psnr(bytes), codec.ms_ssim(bytes)) {
        (None, _) => "-".into(),
        (Some(psnr), None) => format!("{psnr:.2}"),
        (Some(psnr), Some(similar)) => format!("{psnr:.2} {similar:.3}"),
    }
}
