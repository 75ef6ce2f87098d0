//! Looks at a procedural film: `cargo run --release -p weaver-data --example film_strip [SEED]`.
//!
//! Writes film_strip.png: three cameras from left to right of the arc, eight frames each from top to bottom, and beside
//! each photo which kind of motion its pixels show.

use std::time::Instant;
use weaver_data::film::{FilmOptions, MOTIONS, procedural};
use weaver_io::{Image, label_color};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let seed = std::env::args().nth(1).map_or(Ok(5), |seed| seed.parse())?;
    let started = Instant::now();
    let options = FilmOptions::default();
    let film = procedural(seed, &options);
    println!("{}: {} photos in {:.2} s", film.name, film.shots.len(), started.elapsed().as_secs_f64());
    println!("{} points, extent {:.2}, {} held out", film.points.len(), film.extent(), film.held_out().len());

    let kinds = |motion: &[u8]| {
        let labels: Vec<u32> = motion.iter().map(|kind| u32::from(*kind)).collect();
        label_color(&labels, options.width, options.height)
    };
    let mut strip = Image { width: 0, height: 0, pixels: Vec::new() };
    for frame in (0..options.frames).step_by(4) {
        let mut row = Vec::new();
        for camera in [0, options.cameras / 2, options.cameras - 1] {
            let shot = &film.shots[frame * options.cameras + camera];
            row.push(shot.image(film.size)?);
            row.extend(shot.motion.as_deref().map(kinds));
        }
        let row = Image::mosaic(&row.iter().collect::<Vec<_>>());
        strip.width = row.width;
        strip.height += row.height;
        strip.pixels.extend(row.pixels);
    }
    strip.write_png("film_strip.png")?;

    for (kind, name) in MOTIONS.iter().enumerate().skip(1) {
        let seen = |motion: &Vec<u8>| motion.iter().filter(|pixel| usize::from(**pixel) == kind).count();
        let shown: Vec<usize> = film.shots.iter().filter_map(|shot| shot.motion.as_ref()).map(seen).collect();
        let most = shown.iter().max().copied().unwrap_or(0);
        println!(
            "{name}: {} pixels at most, {:.0} on average",
            most,
            shown.iter().sum::<usize>() as f64 / shown.len() as f64
        );
    }
    Ok(())
}
