//! One HTML file of a scene: `page SCENE OUT.html`.

use weaver_view::{HtmlOptions, Look, Subject, html};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(scene), Some(out)) = (arguments.next(), arguments.next()) else {
        return Err("expected a scene and the file to write".into());
    };
    let file = weaver_io::read_scene(&scene)?;
    let mut look = Look::default();
    look.settings.antialiased = file.drawing.antialiased;
    let title = std::path::Path::new(&scene).file_name().map_or(scene.clone(), |name| name.to_string_lossy().into());
    let subject = Subject { title: &title, gaussians: &file.gaussians, look, notes: None, second: None };
    let page = html(&subject, &[], HtmlOptions::default())?;
    weaver_io::write_text(&out, &page)?;
    println!("{out}: {:.1} MB", page.len() as f64 / 1e6);
    Ok(())
}
