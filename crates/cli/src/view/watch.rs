//! `--watch`: tells when a file of the scene was saved.

use super::hub::Hub;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};

/// How often files are looked at. One that changed is read when it has not changed for as long: it may be on its way.
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// Systems write the time of a file by a clock that is behind by up to a tick, of 10 ms at the most.
const TICK: Duration = Duration::from_millis(10);

/// When a file was saved last, and its bytes; `None` where there is none.
type Stamp = Option<(SystemTime, u64)>;

fn stamp(path: &Path) -> Stamp {
    let found = path.metadata().ok()?;
    Some((found.modified().ok()?, found.len()))
}

/// The files that are watched.
#[derive(Default)]
pub struct Watched(Mutex<Stamps>);

#[derive(Default)]
struct Stamps {
    /// Of the files as they were read, or are about to be.
    read: BTreeMap<PathBuf, Stamp>,
    /// At the last look.
    last: BTreeMap<PathBuf, Stamp>,
}

impl Watched {
    /// Watches these files from now on, which were read from `begun` on: what was saved since may not have been read.
    pub fn set(&self, files: Vec<PathBuf>, begun: SystemTime) {
        let mut stamps = self.lock();
        let old = std::mem::take(&mut stamps.read);
        let read = |path: PathBuf| {
            // Of a file that was watched meanwhile it is known better.
            let known = old.get(&path).copied();
            let before = |&(saved, _): &(SystemTime, u64)| saved + TICK < begun;
            let stamp = known.unwrap_or_else(|| stamp(&path).filter(before));
            (path, stamp)
        };
        stamps.read = files.into_iter().map(read).collect();
    }

    /// Whether a file has changed since it was read, and has not changed since the last look. It will be read now.
    fn has_changed(&self) -> bool {
        let mut stamps = self.lock();
        let now: BTreeMap<_, _> = stamps.read.keys().map(|path| (path.clone(), stamp(path))).collect();
        let has_changed = now != stamps.read && now == stamps.last;
        if has_changed {
            stamps.read.clone_from(&now);
        }
        stamps.last = now;
        has_changed
    }

    fn lock(&self) -> MutexGuard<'_, Stamps> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Tells the pages' worker of every change, for as long as the program runs.
pub fn watch(hub: &Hub, watched: &Arc<Watched>) {
    loop {
        std::thread::sleep(LOOK_EVERY);
        if watched.has_changed() {
            hub.ask_reload();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{self, File};

    /// A file that was saved so long ago.
    fn save(path: &Path, text: &str, ago: Duration) {
        fs::write(path, text).unwrap();
        File::options().write(true).open(path).unwrap().set_modified(SystemTime::now() - ago).unwrap();
    }

    const HOUR: Duration = Duration::from_secs(3600);

    #[test]
    fn changes_are_told_once_and_when_they_are_over() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
        save(&a, "1", HOUR);
        let watched = Watched::default();
        let looks = |expected: &[bool]| {
            let found: Vec<_> = expected.iter().map(|_| watched.has_changed()).collect();
            assert_eq!(found, expected);
        };
        watched.set(vec![a.clone(), b.clone()], SystemTime::now());
        looks(&[false, false]);
        save(&a, "12", HOUR);
        looks(&[false]);
        save(&a, "123", HOUR);
        looks(&[false, true, false]);
        // What was missing comes.
        save(&b, "", HOUR);
        looks(&[false, true, false]);
        fs::remove_file(&a).unwrap();
        looks(&[false, true, false]);
    }

    #[test]
    fn what_is_saved_while_it_is_read_is_a_change() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
        let watched = Watched::default();
        // Since reading began an hour ago; a clock that is wrong does not make it a change again and again.
        save(&a, "1", HOUR / 2);
        for expected in [true, false] {
            watched.set(vec![a.clone()], SystemTime::now() - HOUR);
            assert_eq!([(); 3].map(|()| watched.has_changed()), [false, expected, false]);
        }
        // While it is read again, because of another one, which the scene has from then on.
        save(&a, "12", HOUR / 2);
        save(&b, "1", 2 * HOUR);
        watched.set(vec![a.clone(), b.clone()], SystemTime::now() - HOUR);
        assert_eq!([(); 3].map(|()| watched.has_changed()), [false, true, false]);
    }
}
