//! Studies: methods measured against each other on the user's device and scene, each speed with the errors of the same
//! run, and a report of charts and tables. They redo every table and graph of the thesis, and chart speed against
//! accuracy.
//!
//! A [`Study`] measures in a [`Lab`], which times methods by turns, judges their answers and counts their work, and
//! returns [`Findings`]: tables, charts of their columns, and a sentence, computed from the tables, on what the thesis
//! claims. [`Report`] keeps them in a folder, as JSON, CSV, SVG, PNG and one HTML page, and goes on where it was
//! stopped.
//!
//! Bad at: absolute numbers. What a device does beside, its clocks and its driver change them; ratios of one table were
//! measured by turns.

mod bound;
mod cases;
mod chart;
mod draw;
mod fingerprint;
mod journal;
mod lab;
mod lookup;
mod markdown;
mod outcome;
mod page;
mod peers;
mod pictured;
mod repeated;
mod report;
mod scenes;
mod studies;
mod table;

pub use chart::{Chart, ChartKind};
pub use draw::{Format, pixels, standalone_svg, svg};
pub use lab::{Lab, PictureVariant, Subject, Variant};
pub use outcome::Outcome;
pub use peers::{Peer, export_rays};
pub use report::{Entry, Header, Report, State, StudiedScene};
pub use table::{COLUMNS, Column, Row, Table};

use raybrook::low_level::device::KERNEL_FILES;
use raybrook::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::HashSet;

/// One question, and how it is answered: what is measured, and what follows from the rows and from nothing else.
pub struct Study {
    /// As the user types it.
    pub name: &'static str,
    /// In a few words.
    pub title: &'static str,
    /// What the thesis, or whoever is named, says of it.
    pub claim: &'static str,
    /// What of it is measured on the program's own shapes even where the user names scenes.
    pub own_shapes: Option<&'static str>,
    /// The text of the file that has it.
    source: &'static str,
    measure: fn(&mut Lab) -> Result<Vec<Table>>,
    judge: fn(&Measured) -> Result<Findings>,
}

/// The tables of a study, and on what it was made.
struct Measured<'a> {
    study: &'a str,
    tables: Vec<Table>,
    header: &'a Header,
}

impl Measured<'_> {
    /// The table of this name, whose rows the columns of `key` tell apart.
    ///
    /// # Errors
    /// [`Error::Input`] when there is none, and when two rows have the same key.
    fn table(&self, name: &str, key: &[&str]) -> Result<Table> {
        let failed = |message: String| Error::input(format!("study {}", self.study), None, message);
        let table = self.tables.iter().find(|table| table.name == name).cloned();
        let table = table.ok_or_else(|| failed(format!("there is no table '{name}'")))?;
        let mut keys = HashSet::new();
        for row in &table.rows {
            let values: Vec<String> = key.iter().map(|column| table::name(row, column)).collect();
            if !keys.insert(values.clone()) {
                let values = values.join("', '");
                return Err(failed(format!("table '{name}' has '{values}' twice; name each scene once")));
            }
        }
        Ok(table)
    }
}

impl Study {
    /// All of them, in the order of the report.
    pub fn all() -> impl Iterator<Item = &'static Study> {
        studies::ALL.iter()
    }

    /// The one that shows other tracers, and whose rays they trace.
    pub fn of_peers() -> &'static Study {
        &studies::OF_PEERS
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
            Error::option("NAME", format!("there is no study '{name}'; nearest: {hint}; `list` lists all"))
        })
    }

    /// A checksum of the kernels and of the study's own code. A report with another one was made by other code.
    pub fn sources(&self) -> String {
        let mut hasher = crc32fast::Hasher::new();
        KERNEL_FILES.iter().for_each(|(_, text)| hasher.update(text.as_bytes()));
        // Its tests measure nothing.
        let code = self.source.split("#[cfg(test)]").next().unwrap_or_default();
        hasher.update(code.as_bytes());
        format!("{:08x}", hasher.finalize())
    }

    /// Makes the study.
    ///
    /// # Errors
    /// A scene cannot be traced, the device failed, or a measurement is there twice.
    pub fn run(&self, lab: &mut Lab) -> Result<Findings> {
        let tables = (self.measure)(lab)?;
        self.judge(tables, &Header::new(lab))
    }

    /// The same measurements beside those of the lab's other tracers, in place of other tracers' that were there.
    ///
    /// # Errors
    /// Results of a tracer are not for these rays, and as [`Study::judge`].
    fn beside_peers(&self, lab: &Lab, tables: Vec<Table>) -> Result<Findings> {
        self.judge(studies::beside_peers(lab, tables)?, &Header::new(lab))
    }

    /// What follows from what was measured, also by an earlier version of the program: `tables` may be those of its
    /// [`Findings`].
    ///
    /// # Errors
    /// [`Error::Input`] when a table is missing, or has rows that cannot be told apart.
    pub fn judge(&self, mut tables: Vec<Table>, header: &Header) -> Result<Findings> {
        tables.iter_mut().flat_map(|table| &mut table.rows).for_each(lab::bring_up_to_date);
        let mut findings = (self.judge)(&Measured { study: self.name, tables, header })?;
        if let Some(shapes) = self.own_shapes.filter(|_| !header.scenes.is_empty()) {
            findings
                .notes
                .push(format!("Not of the scenes that were named, but of shapes of the program's own: {shapes}."));
        }
        Ok(findings)
    }
}

/// What a study found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Findings {
    /// Whether the claim holds on this device with these scenes.
    #[serde(default)]
    pub outcome: Outcome,
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
    /// Whether the claim holds, as the beginning of the verdict.
    pub fn judgement(&self) -> &'static str {
        match self.outcome {
            Outcome::Holds => "It holds here: ",
            Outcome::Fails => "It does not hold here: ",
            Outcome::Undecided => "Not decided here: ",
        }
    }

    /// The table of this name.
    pub fn table(&self, name: &str) -> Option<&Table> {
        self.tables.iter().find(|table| table.name == name)
    }
}
