//! `--watch`: tells when a file of the scene was saved.

use super::hub::Hub;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};

/// How often files are looked at. One that changed is read when it has not changed for as long: it may be on its way.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// When a file was saved last, and its bytes; `None` where there is none.
type Stamp = Option<(SystemTime, u64)>;

/// The files that are watched.
#[derive(Default)]
pub struct Watched(Mutex<Vec<PathBuf>>);

impl Watched {
    /// Watches these files from now on.
    pub fn set(&self, files: Vec<PathBuf>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = files;
    }

    fn stamps(&self) -> Vec<(PathBuf, Stamp)> {
        let files = self.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let stamp = |path: &PathBuf| {
            let found = path.metadata().ok()?;
            Some((found.modified().ok()?, found.len()))
        };
        files.into_iter().map(|path| (path.clone(), stamp(&path))).collect()
    }
}

/// Tells the pages' worker of every change, for as long as the program runs.
pub fn watch(hub: &Hub, watched: &Arc<Watched>) {
    let mut known = watched.stamps();
    let mut last = known.clone();
    loop {
        std::thread::sleep(LOOK_EVERY);
        let now = watched.stamps();
        // Another list of files is no change of any of them.
        let has_same_files = now.len() == known.len() && now.iter().zip(&known).all(|(a, b)| a.0 == b.0);
        if !has_same_files {
            known.clone_from(&now);
        } else if now != known && now == last {
            known.clone_from(&now);
            hub.ask_reload();
        }
        last = now;
    }
}
