//! Shows a scene until the process is ended: `serve SCENE [CAMERAS]`.

use std::path::Path;
use std::sync::atomic::AtomicBool;
use weaver_view::Look;
use weaver_view_run::{Exhibit, Listener, Server, Visitors};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let scene = arguments.next().ok_or("expected a scene")?;
    let file = weaver_io::read_scene(&scene)?;
    let mut look = Look::default();
    look.settings.antialiased = file.drawing.antialiased;
    let mut exhibit = Exhibit::new(&scene, file.gaussians, look);
    exhibit.file = Some(scene.into());
    if let Some(cameras) = arguments.next() {
        exhibit = exhibit.with_cameras(Path::new(&cameras), None)?;
    }
    let server = Server::new(&exhibit, None, Listener::bind(Visitors::Here, None)?)?;
    println!("{}", server.address());
    server.run(&AtomicBool::new(false));
    Ok(())
}
