//! `raybrook study`.

use super::files::Files;
use super::{DeviceArgs, MemoryArgs, Talk, open};
use raybrook::low_level::budget::MemoryBudget;
use raybrook::low_level::output::check_writable;
use raybrook::low_level::scene::Scene;
use raybrook::{Error, Result};
use raybrook_lab::study::{Header, Lab, Report, State, Study};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct StudyArgs {
    /// Studies, or `all` [default: all].
    #[arg(value_name = "NAME")]
    names: Vec<String>,
    /// Scene to study, instead of those that the program makes; several times for several.
    #[arg(long, value_name = "SCENE")]
    scene: Vec<PathBuf>,
    /// Folder of the report; what is there already, made by the same version on the same device, is not made again.
    #[arg(short, long, value_name = "DIR", default_value = "raybrook-study")]
    output: PathBuf,
    /// Write verdict and tables to a Markdown file, too.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Few rays and passes: minutes instead of an hour.
    #[arg(long)]
    quick: bool,
    /// Make the studies anew, even if they are there already.
    #[arg(long)]
    again: bool,
    /// Judge anew what is in the folder and write its verdicts, tables, charts and page again; nothing is measured,
    /// and no device is needed.
    #[arg(long, conflicts_with_all = ["names", "scene", "quick", "again", "seed", "list"])]
    judge: bool,
    /// Seed of all random numbers.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// List the studies and end.
    #[arg(long)]
    list: bool,
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    memory: MemoryArgs,
}

impl StudyArgs {
    /// Checks that nothing is written that is read as one of `files`, or written twice.
    fn claim(&self, mut files: Files) -> Result<()> {
        let folder = canonical(&self.output);
        let is_written = |path: &Path| Report::writes(&folder, &canonical(path));
        let lost = |option, path: &Path, role: &str| {
            let message = format!("'{}' is {role}, which would be lost; choose another name", path.display());
            Err(Error::option(option, message))
        };
        if let Some((path, role)) = files.inputs().find(|(path, _)| is_written(path)) {
            return lost("-o", path, role);
        }
        match &self.markdown {
            Some(path) if is_written(path) => lost("--markdown", path, "what -o writes"),
            Some(path) => files.write(path, "--markdown"),
            None => Ok(()),
        }
    }
}

/// The path without links as far as it is there.
fn canonical(path: &Path) -> PathBuf {
    let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    path.canonicalize().unwrap_or_else(|_| match path.file_name() {
        Some(name) if parent != path => canonical(parent).join(name),
        _ => path.to_owned(),
    })
}

pub fn run(args: &StudyArgs, talk: Talk) -> Result<()> {
    if args.list {
        for study in Study::all() {
            say!("{:16} {}", study.name, study.title);
        }
        return Ok(());
    }
    if args.judge {
        return judge(args, talk);
    }
    let studies = chosen(&args.names)?;
    let mut files = Files::default();
    args.scene.iter().for_each(|scene| files.read(scene, "a scene"));
    args.claim(files.clone())?;
    // Before an hour of studies, not after it.
    args.markdown.as_deref().map_or(Ok(()), check_writable)?;
    let device = open::choose(&args.device, talk)?;
    let cache = args.device.cache()?;
    let budget = args.memory.budget();
    let mut scenes: Vec<(String, Scene)> = Vec::new();
    for path in &args.scene {
        // Each once: rows of one name could not be told apart.
        let name = name_of(path);
        if scenes.iter().all(|(other, _)| *other != name) {
            scenes.push((name, open::load_completed(path, &budget, talk)?));
        }
    }
    scenes.iter().for_each(|(_, scene)| files.read_scene(scene));
    args.claim(files)?;
    let progress = |what: &str| {
        if !talk.quiet {
            tell!("  {what}");
        }
    };
    let mut lab = Lab::new(device.as_ref(), cache.as_ref(), &scenes, args.quick, args.seed, &progress);
    lab.memory = args.memory.memory_limit.map(MemoryBudget::of_bytes);
    let mut report = Report::open(&args.output, Header::new(&lab), &command(), args.again)?;
    for (i, study) in studies.iter().enumerate() {
        if !talk.quiet {
            tell!("{} of {}: {}: {}", i + 1, studies.len(), study.name, study.title);
            if let Some(shapes) = study.own_shapes.filter(|_| !scenes.is_empty()) {
                tell!("  note: not of the scenes that were named, but of shapes of the program's own: {shapes}");
            }
        }
        let state = report.make(study, &mut lab)?;
        if state == State::Found && !talk.quiet {
            tell!("  it is there already; --again makes it anew");
        }
    }
    report.write_page()?;
    if let Some(path) = &args.markdown {
        report.write_markdown(path, &studies)?;
    }
    say_verdicts(&report, &studies, talk);
    Ok(())
}

/// How a scene is called in reports, where control characters have no place.
fn name_of(path: &Path) -> String {
    let escaped = |c: char| if c.is_control() { c.escape_unicode().to_string() } else { c.to_string() };
    path.display().to_string().chars().map(escaped).collect()
}

/// Judges the report of a folder anew.
fn judge(args: &StudyArgs, talk: Talk) -> Result<()> {
    args.markdown.as_deref().map_or(Ok(()), check_writable)?;
    let studies: Vec<_> = Study::all().collect();
    let report = Report::of_folder(&args.output)?;
    report.write_all()?;
    if let Some(path) = &args.markdown {
        report.write_markdown(path, &studies)?;
    }
    say_verdicts(&report, &studies, talk);
    Ok(())
}

/// Says what was found.
fn say_verdicts(report: &Report, studies: &[&Study], talk: Talk) {
    if talk.quiet {
        return;
    }
    for entry in report.entries().iter().filter(|entry| studies.iter().any(|study| study.name == entry.study)) {
        let holds = match entry.findings.holds {
            Some(true) => "holds: ",
            Some(false) => "does not hold: ",
            None => "",
        };
        say!("{}: {holds}{}", entry.study, entry.findings.verdict);
    }
    say!("{}", report.page().display());
}

/// The studies of these names, each once.
fn chosen(names: &[String]) -> Result<Vec<&'static Study>> {
    if names.is_empty() || names.iter().any(|name| name == "all") {
        let others = names.iter().filter(|name| *name != "all");
        others.map(|name| Study::find(name)).collect::<Result<Vec<_>>>()?;
        return Ok(Study::all().collect());
    }
    let mut studies: Vec<&'static Study> = Vec::new();
    for name in names {
        let study = Study::find(name)?;
        if studies.iter().all(|other| other.name != study.name) {
            studies.push(study);
        }
    }
    Ok(studies)
}

/// What the user typed, but for the place of the program; what is no text is shown with replacements.
fn command() -> String {
    let words = std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned());
    std::iter::once("raybrook".to_owned()).chain(words).collect::<Vec<_>>().join(" ")
}
