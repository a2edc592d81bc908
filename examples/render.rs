//! From a file to a picture: `cargo run --release --example render -- SCENE [PICTURE.png]`.
#![allow(clippy::print_stderr)]

use raybrook::{Result, Scene, Tracer, View};

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let scene = Scene::load(arguments.next().unwrap_or("scenes/vase.obj".to_owned()))?;
    let path = arguments.next().unwrap_or("picture.png".to_owned());

    let mut tracer = Tracer::builder(&scene).progress(|done| eprint!("\r{:3.0} %", 100.0 * done)).build()?;
    let picture = tracer.render(&View::new(640, 480).error(0.5))?;
    picture.save(&path)?;
    eprintln!("\r{path}: {} rays on {}", picture.all_rays(), tracer.device_name());
    tracer.notes().iter().for_each(|note| eprintln!("note: {note}"));
    Ok(())
}
