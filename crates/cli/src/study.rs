//! `raybrook study`.

use super::files::Files;
use super::values::Named;
use super::{DeviceArgs, MemoryArgs, Talk, open};
use clap::builder::{PossibleValue, StringValueParser};
use raybrook::low_level::budget::MemoryBudget;
use raybrook::low_level::output::check_writable;
use raybrook::low_level::scene::Scene;
use raybrook::{Error, Result};
use raybrook_lab::study::{Header, Lab, Outcome, Peer, Report, State, Study, export_rays};
use std::path::{Path, PathBuf};

/// Any text: what is no study is told together with the one that is nearest.
fn study_names() -> Named<StringValueParser> {
    let studies = Study::all().map(|study| PossibleValue::new(study.name).help(study.title));
    Named::new(studies.chain([PossibleValue::new("all")]), StringValueParser::new())
}

#[derive(clap::Args)]
pub struct StudyArgs {
    /// Studies, or `all` [default: all].
    #[arg(value_name = "NAME", hide_possible_values = true, value_parser = study_names())]
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
    #[arg(long, conflicts_with_all = ["names", "scene", "quick", "again", "seed", "list", "peer", "export_rays"])]
    judge: bool,
    /// Another tracer's results on rays of --export-rays, which `pareto` shows beside its own methods; several for
    /// several tracers.
    ///
    /// Its answers are judged as the program's own are. They must be to the rays of the same scenes, seed, device and
    /// options. Where the study is there already, nothing is measured again. benches/peers has programs for Embree and
    /// CGAL; the README.md beside the rays describes the file.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    peer: Vec<PathBuf>,
    /// Write the rays that `pareto` traces, and their meshes, to a folder for other tracers, and end.
    ///
    /// There are rays of each scene and kind, and of each kind of stress rays, the same for the same seed. README.md in
    /// the folder describes the files.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["peer", "markdown", "again", "output"])]
    export_rays: Option<PathBuf>,
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
    check_peers(args, &studies)?;
    let peers = args.peer.iter().map(|path| Peer::read(path)).collect::<Result<Vec<_>>>()?;
    let mut files = Files::default();
    args.scene.iter().for_each(|scene| files.read(scene, "a scene"));
    args.peer.iter().for_each(|peer| files.read(peer, "another tracer's results"));
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
    lab.peers = peers;
    if let Some(folder) = &args.export_rays {
        let sets = export_rays(&lab, folder)?;
        if !talk.quiet {
            say!("{}: {sets} sets of rays", folder.join("manifest.json").display());
        }
        return Ok(());
    }
    let mut report = Report::open(&args.output, Header::new(&lab), &command(), args.again)?;
    report.set_commit(env!("RAYBROOK_COMMIT"));
    for (i, study) in studies.iter().enumerate() {
        if !talk.quiet {
            tell!("{} of {}: {}: {}", i + 1, studies.len(), study.name, study.title);
            if let Some(shapes) = study.own_shapes.filter(|_| !scenes.is_empty()) {
                tell!("  note: not of the scenes that were named, but of shapes of the program's own: {shapes}");
            }
        }
        let state = report.make(study, &mut lab)?;
        let said = match state {
            State::Made => None,
            State::Found => Some("it is there already; --again makes it anew"),
            State::WithPeers => Some("it is there already; other tracers were put beside it"),
        };
        if let Some(said) = said.filter(|_| !talk.quiet) {
            tell!("  {said}");
        }
    }
    report.picture_scenes(&lab)?;
    report.write_page()?;
    if let Some(path) = &args.markdown {
        report.write_markdown(path, &studies)?;
    }
    say_verdicts(&report, &studies, talk);
    Ok(())
}

/// Refuses other tracers, and the export of their rays, for studies without them.
fn check_peers(args: &StudyArgs, studies: &[&Study]) -> Result<()> {
    let name = Study::of_peers().name;
    let has_it = studies.iter().any(|study| study.name == name);
    if !args.peer.is_empty() && !has_it {
        return Err(Error::option("--peer", format!("only the study {name} shows other tracers; name it, too")));
    }
    if args.export_rays.is_some() && !(has_it && studies.len() == 1) {
        let message = format!("only the study {name} has rays for other tracers; name it alone: raybrook study {name}");
        return Err(Error::option("--export-rays", message));
    }
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
        let holds = match entry.findings.outcome {
            Outcome::Holds => "holds: ",
            Outcome::Fails => "does not hold: ",
            Outcome::Undecided => "not decided: ",
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
    let words = super::words().map(|word| word.to_string_lossy().into_owned());
    std::iter::once("raybrook".to_owned()).chain(words).collect::<Vec<_>>().join(" ")
}
