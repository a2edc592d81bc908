//! `raybrook view`: a page in the browser that shows a scene, moves its camera, and tells what is under the pointer.
//!
//! One worker, the main thread, owns the tracers and makes the pictures of all pages, the coarsest first
//! ([`hub`]); a thread for each connection ([`http`]) answers the pages ([`pages`]). They share nothing but the hub.

mod browser;
mod engine;
mod facts;
mod http;
mod hub;
mod message;
mod navigator;
mod pages;
mod pick;
mod session;
mod watch;
mod wrong;

use super::explain::ExplainArgs;
use super::{DeviceArgs, MethodArgs, PictureArgs, SceneArgs, Talk, chain, heading, open};
use engine::Engine;
use facts::SceneFacts;
use http::Limits;
use hub::{Hub, Task};
use pages::Pages;
use raybrook::{Error, Result};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;
use watch::Watched;

#[derive(clap::Args)]
pub struct ViewArgs {
    #[command(flatten)]
    picture: PictureArgs,
    #[command(flatten)]
    method: MethodArgs,
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    explain: ExplainArgs,
    /// Port of 127.0.0.1 to listen on; 0 takes a free one.
    #[arg(long, value_name = "PORT", default_value_t = 0, help_heading = heading::OUTPUT)]
    port: u16,
    /// Open no browser, only print the address.
    #[arg(long, help_heading = heading::OUTPUT)]
    no_open: bool,
    /// Read the scene's files again whenever they are saved.
    ///
    /// What is wrong with them stands on the page then, and the last picture stays.
    #[arg(long)]
    watch: bool,
}

pub fn run(args: &ViewArgs, talk: Talk) -> Result<()> {
    args.method.check(false)?;
    let (listener, port) = http::listen(args.port)?;
    let token = pages::new_token()?;
    let device = open::choose(&args.device, talk)?;
    let begun = SystemTime::now();
    let loaded = engine::load(args, device.as_ref(), talk)?;
    let camera = args.picture.picture(&loaded.scene).camera;
    let facts = SceneFacts {
        scene: args.scene.scene.display().to_string(),
        busy: Some("building the scene".to_owned()),
        ..SceneFacts::default()
    };
    let hub = Arc::new(Hub::new(camera, engine::diagonal(&loaded.scene), facts));
    let address = format!("http://127.0.0.1:{port}/{token}/");
    say!("{address}");
    if !talk.quiet {
        tell!("the page is there until Ctrl-C; from another machine: ssh -L PORT:127.0.0.1:PORT, of the same port");
    }
    let pages = Arc::new(Pages { hub: hub.clone(), token, name: stem(&args.scene.scene) });
    start("server", move || http::serve(&listener, &pages, Limits::USUAL))?;
    let of_sleep = hub.clone();
    start("sleep", move || of_sleep.watch_sleep())?;
    let _opening = if args.no_open { None } else { browser::open(&address, &hub) };
    let mut engine = Engine::open(args, device, loaded, &hub.stop, talk)?;
    let watched = Arc::new(Watched::default());
    watched.set(engine.files(), begun);
    if args.watch {
        let (hub, watched) = (hub.clone(), watched.clone());
        start("watch", move || watch::watch(&hub, &watched))?;
    }
    begin_anew(&engine, &hub);
    loop {
        work(&mut engine, &hub, &watched)?;
    }
}

/// Starts a thread that lives as long as the program.
fn start(name: &str, work: impl FnOnce() + Send + 'static) -> Result<()> {
    let thread = std::thread::Builder::new().name(name.to_owned()).spawn(work);
    thread.map(drop).map_err(|why| Error::io("start", Path::new(name), why))
}

/// The name of the scene for pictures that are saved: of its letters those that no browser minds.
fn stem(scene: &Path) -> String {
    let stem = scene.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let plain: String =
        stem.chars().map(|c| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect();
    if plain.is_empty() { "picture".to_owned() } else { plain }
}

/// Has all pages show what the engine has now.
fn begin_anew(engine: &Engine, hub: &Hub) {
    hub.begin_anew(engine.facts(), engine.pickable(), engine.first_view());
}

/// Does what is to be done next.
///
/// # Errors
/// The device failed: nothing more can be done with it.
fn work(engine: &mut Engine, hub: &Hub, watched: &Watched) -> Result<()> {
    let (doing, done) = match hub.next_task() {
        Task::Draw(job) => {
            let must_open = engine.must_open(job.layer);
            if must_open {
                hub.tell(|facts| facts.busy = Some("compiling and opening what that takes".to_owned()));
            }
            match engine.draw(&job) {
                Ok(shown) => hub.publish(&job, shown),
                Err(Error::Stopped) => {}
                // A device that failed once is not to be trusted.
                Err(error) if error.is_lost_device() => return Err(error),
                Err(error) => hub.give_up(&job, chain(&error)),
            }
            if must_open {
                hub.tell(|facts| facts.busy = None);
            }
            return Ok(());
        }
        Task::Switch(asked) => {
            hub.tell(|facts| facts.busy = Some("building for another method".to_owned()));
            ("the method stays as it was", engine.switch(&asked))
        }
        Task::Reload => {
            hub.tell(|facts| facts.busy = Some("reading the scene again".to_owned()));
            let begun = SystemTime::now();
            let done = engine.reload();
            // What is at fault may be a file that the scene has only now.
            let culprit = done.as_ref().err().and_then(culprit);
            watched.set(engine.files().into_iter().chain(culprit).collect(), begun);
            ("the picture is of the scene as it was", done)
        }
    };
    match done {
        Ok(()) => begin_anew(engine, hub),
        Err(error) if error.is_lost_device() => return Err(error),
        Err(error) => hub.tell(|facts| {
            *facts = SceneFacts { notice: Some(format!("{}; {doing}", chain(&error))), ..engine.facts() };
        }),
    }
    Ok(())
}

/// The file that is at fault.
fn culprit(error: &Error) -> Option<PathBuf> {
    match error {
        Error::Io { path, .. } | Error::Input { path, .. } => Some(path.clone()),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn saved_pictures_have_plain_names() {
        assert_eq!(stem(Path::new("a/vase-1.toml")), "vase-1");
        assert_eq!(stem(Path::new("\"x\r\n.obj")), "_x__");
        assert_eq!(stem(Path::new("/")), "picture");
    }
}
