//! What is measured already, so that a study that was stopped goes on where it was.
//!
//! One line of JSON for each group of measurements: its settings, and its rows. A line that was cut off when the
//! program was stopped is measured again.

use super::table::Row;
use raybrook::low_level::input::read_regular;
use raybrook::low_level::output::write_atomically;
use raybrook::{Error, Result};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

#[derive(Serialize, Deserialize)]
struct Entry {
    key: Value,
    rows: Vec<Row>,
}

/// The journal of one study.
#[derive(Default)]
pub struct Journal {
    path: Option<PathBuf>,
    entries: Vec<Entry>,
}

impl Journal {
    /// The journal in this file, which need not be there, if it belongs to these `settings`; else an empty one, which
    /// replaces it.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be written.
    pub fn open(path: &Path, settings: &Value) -> Result<Journal> {
        let old = String::from_utf8(read_regular(path).unwrap_or_default()).unwrap_or_default();
        let mut lines = old.lines();
        let is_same =
            lines.next().is_some_and(|line| serde_json::from_str::<Value>(line).ok().as_ref() == Some(settings));
        let entries = match is_same {
            true => lines.map_while(|line| serde_json::from_str(line).ok()).collect(),
            false => Vec::new(),
        };
        let journal = Journal { path: Some(path.to_owned()), entries };
        let mut text = format!("{settings}\n");
        for entry in &journal.entries {
            text += &line_of(entry);
        }
        // Whole, so that what is measured already outlives a run that is stopped here.
        write_atomically(path, |out| out.write_all(text.as_bytes()))?;
        Ok(journal)
    }

    /// What was measured with these settings.
    pub fn find(&self, key: &Value) -> Option<Vec<Row>> {
        self.entries.iter().find(|entry| entry.key == *key).map(|entry| entry.rows.clone())
    }

    /// Keeps what was measured.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be written.
    pub fn keep(&mut self, key: &Value, rows: &[Row]) -> Result<()> {
        let entry = Entry { key: key.clone(), rows: rows.to_vec() };
        if let Some(path) = &self.path {
            let append = |path: &Path| File::options().append(true).open(path)?.write_all(line_of(&entry).as_bytes());
            append(path).map_err(|error| Error::io("write", path, error))?;
        }
        self.entries.push(entry);
        Ok(())
    }

    /// Removes the file: the study is finished.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be removed.
    pub fn remove(self) -> Result<()> {
        match &self.path {
            Some(path) => fs::remove_file(path).map_err(|error| Error::io("remove", path, error)),
            None => Ok(()),
        }
    }
}

fn line_of(entry: &Entry) -> String {
    format!("{}\n", serde_json::to_string(entry).expect("texts and numbers serialise"))
}

#[cfg(test)]
mod tests {
    use super::super::table::row;
    use super::*;
    use serde_json::json;

    #[test]
    fn what_was_kept_is_found_again_unless_settings_differ_or_the_line_is_cut_off() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        let settings = json!({"seed": 1});
        let rows = [row([("steps", json!(1.5))])];
        let mut journal = Journal::open(&path, &settings).unwrap();
        journal.keep(&json!("a"), &rows).unwrap();
        journal.keep(&json!("b"), &[]).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, &text[..text.len() - 3]).unwrap();
        let found = Journal::open(&path, &settings).unwrap();
        assert_eq!(found.find(&json!("a")).as_deref(), Some(&rows[..]));
        assert_eq!(found.find(&json!("b")), None);
        assert_eq!(fs::read_to_string(&path).unwrap().lines().count(), 2);
        assert_eq!(Journal::open(&path, &json!({"seed": 2})).unwrap().find(&json!("a")), None);
        Journal::open(&path, &settings).unwrap().remove().unwrap();
        assert!(!path.exists());
    }
}
