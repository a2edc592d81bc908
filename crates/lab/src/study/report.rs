//! A folder with what studies found: `index.html`, and for each study its data as JSON and CSV and its charts as SVG
//! and PNG.

use super::draw::{Format, pixels, standalone_svg};
use super::fingerprint::fingerprint;
use super::journal::Journal;
use super::markdown::markdown;
use super::page;
use super::pictured::{self, PicturedScene};
use super::{Findings, Lab, Study};
use raybrook::low_level::device::{DeviceHandle, DeviceInfo};
use raybrook::low_level::input::read_regular;
use raybrook::low_level::output::{write_atomically, write_json};
use raybrook::low_level::scene::Scene;
use raybrook::{Error, Result};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// What all numbers of a report depend on; another header, another report.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Version of the program.
    pub version: String,
    /// Name of the device.
    pub device: String,
    /// Its kind, driver, units and clock.
    pub device_details: String,
    /// The computer that it is in.
    #[serde(default)]
    pub machine: String,
    /// The user's scenes; empty: the program's own.
    pub scenes: Vec<StudiedScene>,
    /// Of random numbers.
    pub seed: u64,
    /// Whether it was done in a hurry.
    pub quick: bool,
}

/// A scene of the user's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StudiedScene {
    /// Its file's name.
    pub name: String,
    /// Triangles that can be hit.
    pub triangles: usize,
    /// A checksum of all that a picture of it shows.
    pub fingerprint: String,
}

/// The device of a report that was made without one.
pub(super) const REFERENCE: &str = "the reference, on this computer's processor";

impl Header {
    /// The header of what is made in this lab.
    pub fn new(lab: &Lab) -> Header {
        Header {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            device: lab.device.map_or_else(|| REFERENCE.to_owned(), |d| d.info.name.clone()),
            device_details: lab.device.map_or_else(String::new, details),
            machine: machine(),
            scenes: lab.scenes.iter().map(StudiedScene::new).collect(),
            seed: lab.seed,
            quick: lab.quick,
        }
    }

    /// Whether there was no device.
    pub(super) fn is_reference(&self) -> bool {
        self.device == REFERENCE
    }
}

impl StudiedScene {
    fn new((name, scene): &(String, Scene)) -> StudiedScene {
        StudiedScene { name: name.clone(), triangles: scene.hittable().len(), fingerprint: fingerprint(scene) }
    }
}

/// The computer's processor. Where the system does not name it, its architecture.
fn machine() -> String {
    let told = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = told.lines().find_map(|line| Some(line.strip_prefix("model name")?.split_once(':')?.1.trim()));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    format!("{cores} core{} of {}", if cores == 1 { "" } else { "s" }, model.unwrap_or(std::env::consts::ARCH))
}

fn details(device: &DeviceHandle) -> String {
    let DeviceInfo { kind, platform_name, platform_version, driver_version, compute_units, clock_mhz, .. } =
        &device.info;
    let options = match device.compiler_options() {
        "" => String::new(),
        options => format!(", compiled with {options}"),
    };
    format!(
        "{kind}; {platform_name}, {platform_version}, driver {driver_version}; {compute_units} compute units, \
         {clock_mhz} MHz{options}"
    )
}

/// One study of a report.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// The study's name.
    pub study: String,
    /// What was found.
    #[serde(flatten)]
    pub findings: Findings,
    /// The command that made it.
    pub command: String,
    /// Seconds that it took.
    pub seconds: f64,
    /// On what.
    pub header: Header,
    /// The day, of UTC.
    #[serde(default)]
    pub date: String,
    /// The commit of the program; empty where it was not known.
    #[serde(default)]
    pub commit: String,
    /// A checksum of the kernels and of the study's own code: what the numbers may have changed with.
    #[serde(default)]
    pub sources: String,
    /// What an earlier version of the program said of the same rows, where this one says something else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub earlier: Option<String>,
}

impl Entry {
    /// The entry as this version of the program judges its rows.
    ///
    /// # Errors
    /// As [`Study::judge`].
    fn judged_anew(self) -> Result<Entry> {
        let findings = Study::find(&self.study)?.judge(self.findings.tables.clone(), &self.header)?;
        let said = |findings: &Findings| [findings.judgement(), &findings.verdict].concat();
        let is_other = said(&findings) != said(&self.findings);
        let earlier = self.earlier.or_else(|| is_other.then(|| said(&self.findings)));
        Ok(Entry { findings, earlier, ..self })
    }
}

/// The day, of UTC.
fn today() -> String {
    let now = humantime::format_rfc3339_seconds(std::time::SystemTime::now()).to_string();
    now.split('T').next().unwrap_or_default().to_owned()
}

/// How a study came into the report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// It was made.
    Made,
    /// It was there.
    Found,
    /// It was there, and other tracers are now beside it.
    WithPeers,
}

/// A report in a folder.
pub struct Report {
    folder: PathBuf,
    header: Header,
    command: String,
    again: bool,
    entries: Vec<Entry>,
    pictured: Vec<PicturedScene>,
    /// Of the program that makes it; empty where it is not known.
    commit: String,
}

/// The page.
const PAGE: &str = "index.html";
/// Where data and charts lie.
const DATA: &str = "data";
const CHARTS: &str = "charts";
/// In the data: what the scenes look like.
const SCENES: &str = "scenes.json";

impl Report {
    /// The report in `folder`, which is made if it is not there. Studies with the same header that are there are part
    /// of it, and are not made again unless `again` says so; they are judged anew from their rows, since an earlier
    /// version of the program may have judged them otherwise. `command` is how those are made that are.
    ///
    /// # Errors
    /// [`Error::Option`] when a file there that the report would replace is not one of a report, and [`Error::Io`] when
    /// the folder cannot be made or read.
    pub fn open(folder: &Path, header: Header, command: &str, again: bool) -> Result<Report> {
        refuse_foreign(folder)?;
        for folder in [folder.to_owned(), folder.join(DATA), folder.join(CHARTS)] {
            fs::create_dir_all(&folder).map_err(|error| Error::io("create", &folder, error))?;
        }
        let mut report = Report {
            folder: folder.to_owned(),
            header,
            command: command.to_owned(),
            again,
            entries: Vec::new(),
            pictured: pictured::read(&folder.join(DATA).join(SCENES)),
            commit: String::new(),
        };
        let found = Study::all().filter_map(|study| read(&folder.join(DATA), study.name));
        for found in found.filter(|entry| entry.header == report.header).collect::<Vec<_>>() {
            // Rows that cannot be judged are measured again.
            let Ok(judged) = found.clone().judged_anew() else { continue };
            if judged != found {
                report.write(&judged)?;
            }
            report.entries.push(judged);
        }
        Ok(report)
    }

    /// The report that is in `folder`, whatever it was made on: to be judged and drawn anew from its rows, without
    /// measuring.
    ///
    /// # Errors
    /// [`Error::Input`] when there is none or one of its studies cannot be judged, and as [`Report::open`].
    pub fn of_folder(folder: &Path) -> Result<Report> {
        let found: Vec<Entry> = Study::all().filter_map(|study| read(&folder.join(DATA), study.name)).collect();
        let Some(first) = found.first().cloned() else {
            return Err(Error::input(folder, None, "there is no report in this folder"));
        };
        for entry in found.into_iter().filter(|entry| entry.header == first.header) {
            entry.judged_anew()?;
        }
        Report::open(folder, first.header, &first.command, false)
    }

    /// Writes all files of all studies that the report has, and its page.
    ///
    /// # Errors
    /// [`Error::Io`] when one cannot be written.
    pub fn write_all(&self) -> Result<()> {
        self.entries.iter().try_for_each(|entry| self.write(entry))?;
        self.write_page()
    }

    /// Says which commit of the program makes the studies from now on.
    pub fn set_commit(&mut self, commit: &str) {
        commit.clone_into(&mut self.commit);
    }

    /// What was found so far, in the order of [`Study::all`].
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// Whether a report in `folder` may write `path`, a file in it.
    pub fn writes(folder: &Path, path: &Path) -> bool {
        let Ok(inside) = path.strip_prefix(folder) else { return false };
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let of_study = |study: &Study| name.strip_prefix(study.name).is_some_and(|rest| rest.starts_with(['-', '.']));
        let is_in = |part: &str| inside.parent() == Some(Path::new(part));
        let is_scenes = is_in(DATA) && name == SCENES;
        inside == Path::new(PAGE) || is_scenes || (is_in(DATA) || is_in(CHARTS)) && Study::all().any(of_study)
    }

    fn data(&self, name: &str) -> PathBuf {
        self.folder.join(DATA).join(name)
    }

    /// Renders small pictures of the scenes of studies, for the page, unless they are there.
    ///
    /// # Errors
    /// A scene cannot be rendered, or the file cannot be written.
    pub fn picture_scenes(&mut self, lab: &Lab) -> Result<()> {
        let pictured = pictured::of_lab(lab, &self.pictured)?;
        if pictured == self.pictured {
            return Ok(());
        }
        self.pictured = pictured;
        write_json(&self.data(SCENES), &self.pictured)
    }

    /// Makes a study, or takes what is there, and writes all of its files and the page.
    ///
    /// # Errors
    /// Those of the study, and [`Error::Io`] when a file cannot be written.
    pub fn make(&mut self, study: &Study, lab: &mut Lab) -> Result<State> {
        if let Some(found) = self.entries.iter().find(|entry| !self.again && entry.study == study.name) {
            if study.name == Study::of_peers().name && !lab.peers.is_empty() {
                return self.add_peers(study, lab, found.clone());
            }
            // An earlier version may have drawn them.
            self.draw(found)?;
            return Ok(State::Found);
        }
        let start = std::time::Instant::now();
        let settings: Value = json!({"study": study.name, "header": self.header});
        lab.journal = Journal::open(&self.data(&format!("{}.journal", study.name)), &settings)?;
        let findings = study.run(lab)?;
        let entry = Entry {
            study: study.name.to_owned(),
            findings,
            command: self.command.clone(),
            seconds: start.elapsed().as_secs_f64(),
            header: self.header.clone(),
            date: today(),
            commit: self.commit.clone(),
            sources: study.sources(),
            earlier: None,
        };
        self.keep(entry)?;
        std::mem::take(&mut lab.journal).remove()?;
        Ok(State::Made)
    }

    /// Writes an entry and the page with it, in place of the one that was there.
    fn keep(&mut self, entry: Entry) -> Result<()> {
        self.write(&entry)?;
        self.entries.retain(|other| other.study != entry.study);
        self.entries.push(entry);
        let place = |entry: &Entry| Study::all().position(|study| study.name == entry.study);
        self.entries.sort_by_key(place);
        self.write_page()
    }

    /// Puts the lab's other tracers beside what is measured already.
    fn add_peers(&mut self, study: &Study, lab: &Lab, found: Entry) -> Result<State> {
        let findings = study.beside_peers(lab, found.findings.tables)?;
        let command = match found.command == self.command {
            true => found.command,
            false => format!("{}; {}", found.command, self.command),
        };
        self.keep(Entry { findings, command, ..found })?;
        Ok(State::WithPeers)
    }

    fn write(&self, entry: &Entry) -> Result<()> {
        for table in &entry.findings.tables {
            let csv = table.to_csv().map_err(|error| not_written(&table.name, &error))?;
            write_bytes(&self.data(&format!("{}-{}.csv", entry.study, table.name)), &csv)?;
        }
        self.draw(entry)?;
        // Last: with this file the study counts as made.
        write_json(&self.data(&format!("{}.json", entry.study)), entry)
    }

    fn draw(&self, entry: &Entry) -> Result<()> {
        for chart in &entry.findings.charts {
            let Some(table) = entry.findings.table(&chart.table) else { continue };
            let path = |ending: &str| self.folder.join(CHARTS).join(format!("{}-{}.{ending}", entry.study, chart.name));
            let drawing =
                standalone_svg(chart, table, Format::WIDE).map_err(|error| not_written(&chart.name, &error))?;
            write_bytes(&path("svg"), drawing.as_bytes())?;
            let (width, height, bytes) =
                pixels(chart, table, Format::WIDE).map_err(|error| not_written(&chart.name, &error))?;
            write_atomically(&path("png"), |out| write_png(out, width, height, &bytes))?;
        }
        Ok(())
    }

    /// Writes `index.html`.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be written.
    pub fn write_page(&self) -> Result<()> {
        let html = page::html(&self.header, &self.entries, &self.pictured);
        write_bytes(&self.folder.join(PAGE), html.as_bytes())
    }

    /// Writes verdicts and tables of some studies, as far as they are made, as Markdown.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be written.
    pub fn write_markdown(&self, path: &Path, studies: &[&Study]) -> Result<()> {
        let study_of = |entry: &Entry| studies.iter().copied().find(|study| study.name == entry.study);
        let made = self.entries.iter().filter_map(|entry| Some((study_of(entry)?, entry)));
        write_bytes(path, markdown(&self.header.device, made).as_bytes())
    }

    /// The page.
    pub fn page(&self) -> PathBuf {
        self.folder.join(PAGE)
    }
}

/// Refuses a folder in which a report would replace what is none of its own: every page of a report has the same
/// beginning of a title, and every file of data tells its study and device, whatever version of the program made them.
fn refuse_foreign(folder: &Path) -> Result<()> {
    let data = |name: &str, ending: &str| folder.join(DATA).join(format!("{name}.{ending}"));
    let title = format!("<title>{}", page::TITLE);
    let is_page = |bytes: &[u8]| memchr::memmem::find(bytes, title.as_bytes()).is_some();
    refuse_unless(is_page, &folder.join(PAGE))?;
    for Study { name, .. } in Study::all() {
        let is_data = |bytes: &[u8]| {
            let beginning = format!("{{\n  \"study\": \"{name}\",");
            match serde_json::from_slice::<Value>(bytes) {
                Ok(value) => value["study"] == *name && value["header"]["device"].is_string(),
                // Half a file, of a version that a full disk could do that to.
                Err(_) => bytes.starts_with(beginning.as_bytes()),
            }
        };
        refuse_unless(is_data, &data(name, "json"))?;
        let beginning = format!("{{\"study\":\"{name}\"");
        refuse_unless(|bytes: &[u8]| bytes.starts_with(beginning.as_bytes()), &data(name, "journal"))?;
    }
    Ok(())
}

/// Refuses what is there and not as it should be; an empty file is nobody's loss.
fn refuse_unless(is_own: impl Fn(&[u8]) -> bool, path: &Path) -> Result<()> {
    let is_foreign = match path.metadata() {
        Ok(found) if found.is_file() => {
            let bytes = read_regular(path).map_err(|error| Error::io("read", path, error))?;
            !bytes.is_empty() && !is_own(&bytes)
        }
        Ok(_) => true,
        Err(_) => false,
    };
    match is_foreign {
        true => {
            let message = format!(
                "'{}' is no part of a report by raybrook, and would be replaced; choose another folder",
                path.display()
            );
            Err(Error::option("output", message))
        }
        false => Ok(()),
    }
}

/// A file that is not there, or not whole, or of another version of the program is made anew.
fn read(data: &Path, study: &str) -> Option<Entry> {
    serde_json::from_slice(&read_regular(&data.join(format!("{study}.json"))).ok()?).ok()
}

/// What a format's own library reports.
fn not_written(what: &str, error: &dyn std::fmt::Display) -> Error {
    Error::io("write", what, std::io::Error::other(error.to_string()))
}

fn write_bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    write_atomically(path, |out| out.write_all(bytes))
}

/// Writes a picture of three bytes a pixel as PNG.
pub(super) fn write_png(out: impl Write, width: u32, height: u32, bytes: &[u8]) -> io::Result<()> {
    let mut encoder = png::Encoder::new(out, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(bytes)?;
    Ok(writer.finish()?)
}
