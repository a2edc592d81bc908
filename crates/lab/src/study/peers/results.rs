//! What another tracer found and how long it took: a JSON file and files with its answers.
//!
//! Nothing in them is believed: what does not belong to the very rays of the study is refused with the file and the set
//! at fault, and a number that is none makes a hit wrong.

use super::Identity;
use crate::stress::Case;
use raybrook::low_level::input::open_regular;
use raybrook::low_level::shared::{Hit, NO_PRIMITIVE};
use raybrook::{Error, Result};
use serde::Deserialize;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

const FORMAT: &str = "raybrook peer 1";
/// A file of results is larger by none that is meant: a few hundred bytes for each set.
const MOST_JSON_BYTES: u64 = 16 << 20;
/// Characters of names: they stand beside points.
const LONGEST_NAME: usize = 40;
const LONGEST_TEXT: usize = 200;
/// Bytes of an answer: t, u, v and the triangle.
const ANSWER_BYTES: usize = 16;
/// No mesh has this triangle: a hit with it is wrong, whatever is right.
const NEVER_RIGHT: u32 = NO_PRIMITIVE - 1;

/// What a tracer's seconds are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub enum Clock {
    /// From the beginning of a pass to its end.
    #[serde(rename = "wall clock")]
    Wall,
    /// What the device says its kernels took.
    #[serde(rename = "device time")]
    Device,
}

impl Clock {
    /// As tables have it.
    pub fn name(self) -> &'static str {
        match self {
            Clock::Wall => "wall clock",
            Clock::Device => "device time",
        }
    }
}

/// The file, as it is written.
#[derive(Debug, Clone, Deserialize)]
struct File {
    format: String,
    rays: Identity,
    name: String,
    version: String,
    #[serde(default)]
    mode: String,
    machine: String,
    threads: u32,
    clock: Clock,
    sets: Vec<PeerSet>,
}

/// A set's results.
#[derive(Debug, Clone, Deserialize)]
struct PeerSet {
    set: String,
    checksum: String,
    rays: usize,
    #[serde(default)]
    call: String,
    #[serde(default)]
    seconds: Vec<f64>,
    answers: Option<PathBuf>,
}

/// Another tracer's results.
#[derive(Debug, Clone)]
pub struct Peer {
    path: PathBuf,
    file: File,
}

/// What a tracer made of one set.
pub(super) struct Results<'a> {
    /// Seconds of each pass; none of stress rays.
    pub seconds: &'a [f64],
    /// The function that traced.
    pub call: &'a str,
    pub hits: Vec<Hit>,
    /// Of the secondary rays, if the set has some.
    pub next_hits: Option<Vec<Hit>>,
}

impl Peer {
    /// Reads a file of results; the answers are read when they are judged.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be read, [`Error::Input`] when it is not one.
    pub fn read(path: &Path) -> Result<Peer> {
        let refuse = |message: String| Error::input(path, None, message);
        let (file, bytes) = open_regular(path)?;
        if bytes > MOST_JSON_BYTES {
            return Err(refuse(format!("{bytes} bytes are more than a tracer's results have")));
        }
        let mut text = Vec::new();
        file.take(MOST_JSON_BYTES).read_to_end(&mut text).map_err(|error| Error::io("read", path, error))?;
        let file: File = serde_json::from_slice(&text)
            .map_err(|error| refuse(format!("these are no results of a tracer: {error}")))?;
        let peer = Peer { path: path.to_owned(), file };
        peer.check()?;
        Ok(peer)
    }

    fn refuse(&self, message: impl Into<String>) -> Error {
        Error::input(&self.path, None, message)
    }

    /// What can be wrong without knowing the study's rays.
    fn check(&self) -> Result<()> {
        let file = &self.file;
        if file.format != FORMAT {
            return Err(self.refuse(format!("its format is '{}', but must be '{FORMAT}'", printable(&file.format))));
        }
        let texts = [
            ("name", &file.name, 1, LONGEST_NAME),
            ("version", &file.version, 1, LONGEST_NAME),
            ("mode", &file.mode, 0, LONGEST_NAME),
            ("machine", &file.machine, 1, LONGEST_TEXT),
        ];
        let calls = file.sets.iter().map(|set| ("call", &set.call, 0, LONGEST_TEXT));
        for (what, text, least, most) in texts.into_iter().chain(calls) {
            if !(least..=most).contains(&text.chars().count()) || text.chars().any(char::is_control) {
                let message = format!("'{what}' must have {least} to {most} characters, none a control character");
                return Err(self.refuse(message));
            }
        }
        if file.threads == 0 {
            return Err(self.refuse("'threads' must be at least 1"));
        }
        for (i, set) in file.sets.iter().enumerate() {
            if file.sets[..i].iter().any(|other| other.set == set.set) {
                return Err(self.refuse(format!("set '{}' is there twice", printable(&set.set))));
            }
            if !set.seconds.iter().all(|&seconds| seconds > 0.0 && seconds.is_finite()) {
                return Err(self.refuse(format!("set '{}': seconds must be above 0", printable(&set.set))));
            }
        }
        Ok(())
    }

    /// The method's name in tables and charts.
    pub fn label(&self) -> String {
        let File { name, version, mode, threads, .. } = &self.file;
        let mode = if mode.is_empty() { String::new() } else { format!(" {mode}") };
        let plural = if *threads == 1 { "" } else { "s" };
        format!("{name} {version}{mode}, {threads} thread{plural}")
    }

    /// Where it was read.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// On what it ran.
    pub fn machine(&self) -> &str {
        &self.file.machine
    }

    /// On how many threads.
    pub fn threads(&self) -> u32 {
        self.file.threads
    }

    /// What its seconds are.
    pub fn clock(&self) -> Clock {
        self.file.clock
    }

    /// Refuses results for other rays than those of this seed and size, and those that lack a set or have one that the
    /// study does not.
    pub(super) fn check_rays(&self, seed: u64, quick: bool, side: u32, names: &[&str]) -> Result<()> {
        let rays = &self.file.rays;
        let advice = "export the rays by the options of this study, and trace them again";
        if rays.seed != seed {
            return Err(self.refuse(format!("its rays have seed {}, but the study has {seed}; {advice}", rays.seed)));
        }
        if rays.quick != quick {
            let [its, ours] = [rays.quick, quick].map(|quick| if quick { "a quick study" } else { "a full study" });
            return Err(self.refuse(format!("its rays are those of {its}, but this is {ours}; {advice}")));
        }
        if rays.side != side {
            let message = format!(
                "its camera rays are of {0} x {0} pixels, but those of the study of {side} x {side}",
                rays.side
            );
            return Err(self.refuse(format!("{message}, which depends on the device; {advice}")));
        }
        let is_there = |name: &str| self.file.sets.iter().any(|set| set.set == name);
        if let Some(missing) = names.iter().find(|name| !is_there(name)) {
            return Err(self.refuse(format!("it has no results for set '{missing}', which the study traces; {advice}")));
        }
        match self.file.sets.iter().find(|set| !names.contains(&set.set.as_str())) {
            Some(other) => {
                let name = printable(&other.set);
                Err(self.refuse(format!("set '{name}' is not one of the study, which may have other scenes; {advice}")))
            }
            None => Ok(()),
        }
    }

    /// Refuses results for rays of another checksum, of all sets together.
    pub(super) fn check_whole(&self, checksum: &str) -> Result<()> {
        let its = &self.file.rays.checksum;
        match its == checksum {
            true => Ok(()),
            false => {
                let its = printable(its);
                Err(self
                    .refuse(format!("its manifest has the checksum '{its}', but that of the study is '{checksum}'")))
            }
        }
    }

    /// The results for a set.
    ///
    /// # Errors
    /// [`Error::Input`] when they are not for this `case`, of this `checksum`, or not whole.
    pub(super) fn results(&self, name: &str, case: &Case, checksum: &str, is_timed: bool) -> Result<Results<'_>> {
        let refuse = |message: String| self.refuse(format!("set '{name}': {message}"));
        let Some(set) = self.file.sets.iter().find(|set| set.set == name) else {
            return Err(refuse("it is missing".to_owned()));
        };
        if set.checksum != checksum {
            let its = printable(&set.checksum);
            return Err(refuse(format!("its rays have the checksum '{its}', but those of the study '{checksum}'")));
        }
        if set.rays != case.rays.len() {
            return Err(refuse(format!("{} rays were traced, but there are {}", set.rays, case.rays.len())));
        }
        if is_timed && set.seconds.is_empty() {
            return Err(refuse("it has no seconds".to_owned()));
        }
        let Some(answers) = &set.answers else {
            return Err(refuse("it has no answers, and a speed without its errors is not shown".to_owned()));
        };
        if !answers.components().all(|part| matches!(part, Component::Normal(_))) {
            return Err(refuse("'answers' must be a file in the folder of its JSON, or below it".to_owned()));
        }
        let path = self.path.parent().unwrap_or(Path::new("")).join(answers);
        let second_rays = if case.has_second_rays() { case.rays.len() } else { 0 };
        let mut hits = read_answers(&path, case, case.rays.len() + second_rays)?;
        let next_hits = hits.split_off(case.rays.len());
        let next_hits = case.has_second_rays().then_some(next_hits);
        Ok(Results { seconds: &set.seconds, call: &set.call, hits, next_hits })
    }
}

/// Reads so many answers.
fn read_answers(path: &Path, case: &Case, count: usize) -> Result<Vec<Hit>> {
    let (file, bytes) = open_regular(path)?;
    let expected = count * ANSWER_BYTES;
    if bytes != expected as u64 {
        let message = format!("{count} answers of {ANSWER_BYTES} bytes are {expected} bytes, but it has {bytes}");
        return Err(Error::input(path, None, message));
    }
    let mut data = Vec::new();
    file.take(bytes).read_to_end(&mut data).map_err(|error| Error::io("read", path, error))?;
    let triangles = case.mesh.triangles.len();
    let answer = |(i, bytes): (usize, &[u8])| {
        let [t, u, v, primitive] =
            [0, 4, 8, 12].map(|at| u32::from_le_bytes(std::array::from_fn(|byte| bytes[at + byte])));
        if primitive != NO_PRIMITIVE && primitive as usize >= triangles {
            let message = format!("answer {i} is triangle {primitive}, but the mesh has {triangles}");
            return Err(Error::input(path, None, message));
        }
        let hit = Hit { t: f32::from_bits(t), u: f32::from_bits(u), v: f32::from_bits(v), primitive };
        // Comparisons with NaN are false, whichever way the judge asks.
        let is_number = [hit.t, hit.u, hit.v].iter().all(|number| number.is_finite());
        let is_wrong = primitive != NO_PRIMITIVE && !case.any_hit && !is_number;
        Ok(if is_wrong { Hit { primitive: NEVER_RIGHT, ..hit } } else { hit })
    };
    let answers = data.chunks_exact(ANSWER_BYTES).enumerate().map(answer).collect::<Result<Vec<_>>>()?;
    match answers.len() == count {
        true => Ok(answers),
        false => Err(Error::input(path, None, "it became shorter while it was read")),
    }
}

/// A text of a file, as a message may have it.
fn printable(text: &str) -> String {
    text.chars().take(LONGEST_NAME * 2).flat_map(char::escape_debug).collect()
}
