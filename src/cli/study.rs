//! `raybrook study`.

use super::{DeviceArgs, Talk, open};
use raybrook::Result;
use raybrook::output::check_writable;
use raybrook::study::{Header, Lab, Report, State, Study};
use std::path::PathBuf;

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
    /// Seed of all random numbers.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// List the studies and end.
    #[arg(long)]
    list: bool,
    #[command(flatten)]
    device: DeviceArgs,
}

pub fn run(args: &StudyArgs, talk: Talk) -> Result<()> {
    if args.list {
        for study in Study::all() {
            say!("{:16} {}", study.name, study.title);
        }
        return Ok(());
    }
    let studies = chosen(&args.names)?;
    // Before an hour of studies, not after it.
    args.markdown.as_deref().map_or(Ok(()), check_writable)?;
    let device = open::choose(&args.device, talk)?;
    let cache = args.device.cache()?;
    let load = |path: &PathBuf| Ok((path.display().to_string(), open::load(path, None, talk)?.scene));
    let scenes = args.scene.iter().map(load).collect::<Result<Vec<_>>>()?;
    let progress = |what: &str| {
        if !talk.quiet {
            eprintln!("  {what}");
        }
    };
    let mut lab = Lab::new(device.as_ref(), cache.as_ref(), &scenes, args.quick, args.seed, &progress);
    let mut report = Report::open(&args.output, Header::new(&lab), &command(), args.again)?;
    for (i, study) in studies.iter().enumerate() {
        if !talk.quiet {
            eprintln!("{} of {}: {}: {}", i + 1, studies.len(), study.name, study.title);
        }
        let state = report.make(study, &mut lab)?;
        if state == State::Found && !talk.quiet {
            eprintln!("  it is there already; --again makes it anew");
        }
    }
    report.write_page()?;
    if let Some(path) = &args.markdown {
        report.write_markdown(path, &studies)?;
    }
    if !talk.quiet {
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
    Ok(())
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

/// What the user typed, but for the place of the program.
fn command() -> String {
    std::iter::once("raybrook".to_owned()).chain(std::env::args().skip(1)).collect::<Vec<_>>().join(" ")
}
