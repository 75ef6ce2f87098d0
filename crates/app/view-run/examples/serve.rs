//! Shows a scene until the process is ended: `serve SCENE [CAMERAS]`.

use std::path::Path;
use std::sync::atomic::AtomicBool;
use weaver_view::Look;
use weaver_view_run::{Access, Listener, ScenePage, Server};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let scene = arguments.next().ok_or("expected a scene")?;
    let file = weaver_io::read_scene(&scene)?;
    let mut look = Look::default();
    look.settings.antialiased = file.drawing.antialiased;
    let mut scene_page = ScenePage::new(&scene, file.gaussians, look);
    scene_page.file = Some(scene.into());
    if let Some(cameras) = arguments.next() {
        scene_page = scene_page.with_cameras(Path::new(&cameras), None)?;
    }
    let server = Server::new(&scene_page, None, Listener::bind(Access::Local, None)?)?;
    println!("{}", server.address());
    server.run(&AtomicBool::new(false));
    Ok(())
}
