//! Opens the page in a browser, where there is a desktop.
//!
//! Everybody on a machine sees with which arguments programs were started. So the browser is not given the address,
//! which holds the token, but a file that leads there and that nobody else may read, as Jupyter does.

use super::super::stop;
use super::hub::Hub;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tempfile::TempPath;

/// So long the file is there, unless the page begins sooner.
const PATIENCE: Duration = Duration::from_secs(60);

/// The file that leads to the page. It is gone when this is dropped, when a page has begun, and when the run is
/// stopped.
pub struct Opening(Arc<Mutex<Option<TempPath>>>);

impl Drop for Opening {
    fn drop(&mut self) {
        remove(&self.0);
    }
}

fn remove(file: &Mutex<Option<TempPath>>) {
    file.lock().unwrap_or_else(PoisonError::into_inner).take();
}

/// Opens a browser, where there is a desktop. That none opens is no failure: the address is printed.
pub fn open(address: &str, hub: &Arc<Hub>) -> Option<Opening> {
    let (program, arguments) = opener()?;
    let file = leading_to(address, &folder()).ok()?;
    let mut command = Command::new(program);
    command.args(arguments).arg(&file).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let file = Arc::new(Mutex::new(Some(file)));
    let (opening, of_stop, hub) = (Opening(file.clone()), file.clone(), hub.clone());
    stop::before_stop(move || remove(&of_stop));
    let mut child = command.spawn().ok()?;
    let wait = move || {
        hub.wait_for_page(PATIENCE);
        remove(&file);
        // Whoever does not wait leaves a zombie behind.
        child.wait()
    };
    std::thread::Builder::new().name("browser".to_owned()).spawn(wait).ok()?;
    Some(opening)
}

/// A file in `folder` that leads a browser to `address`, for this user alone.
fn leading_to(address: &str, folder: &Path) -> std::io::Result<TempPath> {
    let mut file = tempfile::Builder::new().prefix("raybrook-view-").suffix(".html").tempfile_in(folder)?;
    // What the address has, digits and letters but for `:/.`, needs no escapes.
    write!(
        file,
        "<!doctype html>\n<meta charset=\"utf-8\">\n<title>raybrook view</title>\n\
         <meta http-equiv=\"refresh\" content=\"0; url={address}\">\n<p><a href=\"{address}\">raybrook view</a>\n"
    )?;
    file.flush()?;
    Ok(file.into_temp_path())
}

/// Where browsers may read. Those that Linux distributions confine (snaps) see neither `/tmp` nor hidden folders.
fn folder() -> PathBuf {
    let home = std::env::home_dir().filter(|home| cfg!(target_os = "linux") && home.is_dir());
    home.unwrap_or_else(std::env::temp_dir)
}

/// What opens a file in the browser on this system.
fn opener() -> Option<(&'static str, &'static [&'static str])> {
    if cfg!(target_os = "macos") {
        return Some(("open", &[]));
    }
    if cfg!(windows) {
        return Some(("rundll32", &["url.dll,FileProtocolHandler"]));
    }
    let has_display = ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
    has_display.then_some(("xdg-open", &[]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_leads_to_the_page_and_nobody_else_reads_it() {
        let folder = tempfile::tempdir().unwrap();
        let address = "http://127.0.0.1:8080/0123abcd/";
        let file = leading_to(address, folder.path()).unwrap();
        let text = std::fs::read_to_string(&file).unwrap();
        assert!(text.contains(&format!("content=\"0; url={address}\"")), "{text}");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            assert_eq!(file.metadata().unwrap().permissions().mode() & 0o777, 0o600);
        }
        drop(Opening(Arc::new(Mutex::new(Some(file)))));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
