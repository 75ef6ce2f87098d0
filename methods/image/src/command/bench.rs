//! `splatweaver image bench`.

use crate::command::arguments::ImageBench;
use crate::command::measure::{Measured, measure};
use crate::command::others::{Codec, OWN, codecs};
use crate::command::read::{failure, read};
use crate::command::report;
use crate::command::results::Method;
use weaver_command::{Console, Failure};
use weaver_io::{Image, OutputFolder};
use weaver_kernels::peak;
use weaver_run::{Folder, Page};

pub fn run(arguments: &ImageBench, console: &mut Console) -> Result<(), Failure> {
    let threads = rayon::current_num_threads();
    if let Some(ratio) = arguments.ratios.iter().find(|ratio| !(**ratio > 0.0 && ratio.is_finite())) {
        return Err(Failure::Usage(format!("--ratios: expected numbers above 0, found {ratio}")));
    }
    let out = arguments.out.as_deref().map(|out| OutputFolder::claim(out, "image bench", &arguments.pictures));
    let out = out.transpose()?;
    let gflops = peak::fma_gflops_f32(threads);
    let source = if arguments.others.is_some() { "codecs from the files given" } else { OWN };
    console.print(&format!("{threads} threads, {gflops:.0} GFLOP/s at most; beside: {source}, at equal bytes"))?;
    let mut page = Page::new("Pictures as Gaussians and by other codecs");
    page.heading(1, "Pictures as Gaussians and by other codecs");
    page.paragraph("Columns of other codecs: PSNR and MS-SSIM at the same bytes, between their two nearest files.");
    for path in &arguments.pictures {
        let picture = read(path, console)?;
        let (width, height) = (picture.width(), picture.height());
        console.print(&format!("{}: {width} x {height}", path.display()))?;
        let codecs = codecs(path, &picture, arguments.others.as_deref())?;
        let names: String = codecs.iter().map(|codec| format!("  {:>12}", codec.name)).collect();
        console.print(&format!(
            "ratio  Gaussians   bytes  bits/px     dB  MS-SSIM{names}  ms/step  last step  floor  decode ms/Mpx  region us"
        ))?;
        let mut measured = Vec::new();
        for ratio in arguments.ratios.iter().copied() {
            let (steps, seed) = (arguments.steps as usize, arguments.seed);
            let method = Method { ratio: Some(ratio), gaussians: None, steps, seed, coarse: false, published: false };
            let at = measure(&picture, path, &method, gflops).map_err(|error| failure(path, &error))?;
            console.print(&line(&at, &codecs))?;
            measured.push(at);
        }
        if out.is_some() {
            let photo = Image { width, height, pixels: picture.colors().to_vec() };
            let name = path.file_stem().unwrap_or_default().to_string_lossy();
            report::add(&mut page, &name, &photo, &measured, &codecs)?;
        }
    }
    match out {
        Some(out) => {
            let file = out.file(Folder::REPORT)?;
            page.write(&file)?;
            console.print(&file.display().to_string())
        }
        None => Ok(()),
    }
}

fn line(at: &Measured, codecs: &[Codec]) -> String {
    let row = &at.judged.row;
    let beside: String = codecs.iter().map(|codec| format!("  {:>12}", report::beside(codec, row.bytes))).collect();
    let [each, last, floor] = at.steps;
    format!(
        "{:>5}  {:>9}  {:>6}  {:>7.3}  {:>5.2}  {:>7}{beside}  {each:>7.2}  {last:>9.2}  {floor:>5.2}  {:>13.1}  {:>9.0}",
        at.ratio,
        row.gaussians,
        row.bytes,
        row.bits_per_pixel(),
        row.psnr,
        row.ms_ssim.map_or("-".into(), |x| format!("{x:.3}")),
        at.decoding,
        at.region
    )
}
