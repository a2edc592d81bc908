//! Studies: methods measured against each other on the user's device and scene, each speed with the errors of the same run, and a
//! report of charts and tables. They redo every table and graph of the thesis, and chart speed against accuracy.
//!
//! A [`Study`] measures in a [`Lab`], which times methods by turns, judges their answers and counts their work, and returns
//! [`Findings`]: tables, charts of their columns, and a sentence, computed from the tables, on what the thesis claims. [`Report`] keeps
//! them in a folder, as JSON, CSV, SVG, PNG and one HTML page, and goes on where it was stopped.
//!
//! Bad at: absolute numbers. What a device does beside, its clocks and its driver change them; ratios of one table were measured by turns.

mod cases;
mod chart;
mod draw;
mod fingerprint;
mod journal;
mod lab;
mod markdown;
mod page;
mod report;
mod scenes;
mod studies;
mod table;

pub use chart::{Chart, ChartKind};
pub use draw::{Format, pixels, svg};
pub use lab::{Lab, PictureVariant, Subject, Variant};
pub use report::{Entry, Header, Report, State, StudiedScene};
pub use table::{COLUMNS, Column, Row, Table};

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// One question, and how it is answered.
pub struct Study {
    /// As the user types it.
    pub name: &'static str,
    /// In a few words.
    pub title: &'static str,
    /// What the thesis, or whoever is named, says of it.
    pub claim: &'static str,
    run: fn(&mut Lab) -> Result<Findings>,
}

impl Study {
    /// All of them, in the order of the report.
    pub fn all() -> impl Iterator<Item = &'static Study> {
        studies::ALL.iter()
    }

    /// The study of this name.
    ///
    /// # Errors
    /// [`Error::Option`] when there is none; the message has the nearest name.
    pub fn find(name: &str) -> Result<&'static Study> {
        Study::all().find(|study| study.name == name).ok_or_else(|| {
            let likeness = |study: &&Study| strsim::jaro_winkler(study.name, name);
            let nearest = Study::all().max_by(|a, b| likeness(a).total_cmp(&likeness(b)));
            let hint = nearest.map_or("", |study| study.name);
            Error::option("NAME", format!("there is no study '{name}'; nearest: {hint}; --list lists all"))
        })
    }

    /// Makes the study.
    ///
    /// # Errors
    /// A scene cannot be traced, or the device failed.
    pub fn run(&self, lab: &mut Lab) -> Result<Findings> {
        (self.run)(lab)
    }
}

/// What a study found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Findings {
    /// Whether the claim holds on this device with these scenes; `None` where the study cannot tell.
    pub holds: Option<bool>,
    /// That in one sentence, with the numbers that it follows from.
    pub verdict: String,
    /// What else a reader should know.
    pub notes: Vec<String>,
    /// The measurements.
    pub tables: Vec<Table>,
    /// What they look like.
    pub charts: Vec<Chart>,
}

impl Findings {
    /// Whether the claim holds, as the beginning of the verdict; empty where the study cannot tell.
    pub fn judgement(&self) -> &'static str {
        match self.holds {
            Some(true) => "It holds here: ",
            Some(false) => "It does not hold here: ",
            None => "",
        }
    }

    /// The table of this name.
    pub fn table(&self, name: &str) -> Option<&Table> {
        self.tables.iter().find(|table| table.name == name)
    }
}
