//! `raybrook stress`: hard rays with exact answers, and how many of them a method gets wrong.

pub mod kept;
mod table;

use super::code::{Code, FOUND_A_DIFFERENCE, SUCCESS};
use super::files::Files;
use super::keep::{KeepArgs, journal_of, refuse_journal};
use super::limit::{Limit, LimitArgs};
use super::values::Named;
use super::{DeviceArgs, MemoryArgs, MethodArgs, Talk, asked, closed, flags, open, print, stop};
use clap::builder::{PossibleValue, StringValueParser};
use kept::{Cell, Counts, StressId, StressKeeper};
use raybrook::low_level::device::{Cache, DeviceHandle};
use raybrook::low_level::options::{Intersector, StructureKind, TraceOptions};
use raybrook::low_level::output::{check_writable, write_json};
use raybrook::low_level::scene;
use raybrook::{Error, Result};
use raybrook_lab::stress::{Case, Exact, Fault, Kind, Method, Question, Replay};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;
use table::Table;

/// Exact answers take about a kilobyte each, and all of a kind are kept until every method is judged. More rays come
/// from other seeds.
const MAX_RAYS: u64 = 1_000_000;
/// Rays of each kind unless told otherwise.
const DEFAULT_RAYS: u64 = 1000;

/// Any text: what is no kind is told together with the one that is nearest.
fn kind_names() -> Named<StringValueParser> {
    let kinds = every_kind().map(|kind| PossibleValue::new(kind.name).help(kind.about));
    Named::new(kinds.chain([PossibleValue::new("all")]), StringValueParser::new())
}

/// With those that only lists and walks are asked of.
fn every_kind() -> impl Iterator<Item = &'static Kind> {
    Kind::all().chain(Kind::stacks())
}

/// A whole number, also as 1e9.
fn parse_count(text: &str) -> std::result::Result<u64, String> {
    let whole = |x: f64| (x.fract() == 0.0 && (1.0..=MAX_EXACT_COUNT).contains(&x)).then_some(x as u64);
    let count = text.parse().ok().filter(|&n| n > 0).or_else(|| whole(text.parse().ok()?));
    count.ok_or_else(|| format!("'{text}' is no whole number above 0, such as 1000 or 1e6"))
}

/// Up to here every whole number is a double.
const MAX_EXACT_COUNT: f64 = (1u64 << f64::MANTISSA_DIGITS) as f64;

#[derive(clap::Args)]
pub struct StressArgs {
    /// Kinds of rays, or all; --list lists them.
    #[arg(value_name = "KIND", default_value = "all", hide_possible_values = true, value_parser = kind_names())]
    kinds: Vec<String>,
    /// List the kinds.
    #[arg(long)]
    list: bool,
    /// What to ask of each ray. Lists and walks are judged as strictly as `exact` whatever the triangle test, and have
    /// kinds of their own besides, which begin with `stack-`.
    #[arg(long, value_name = "QUESTION", default_value = Question::default().name(), value_parser = asked::parser())]
    ask: Question,
    /// Which rays: the same number makes the same ones everywhere.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub(super) seed: u64,
    /// Rays of each kind [default: 1000]; with --closed rays of all models together [default: 1e6].
    #[arg(long, value_name = "N", value_parser = parse_count)]
    pub(super) rays: Option<u64>,
    /// Judge every triangle test as strictly as `exact`: lowest number of equally near triangles, t the nearest float,
    /// u and v within 2 ulp. Else others may be off by what float32 cannot do better.
    #[arg(long)]
    strict: bool,
    /// A table of several methods. Without names: every triangle test, structure, build and traversal; else names of
    /// these, joined by + where several are meant, such as exact,grid+watertight,median+restart.
    #[arg(
        long,
        value_name = "NAMES",
        num_args = 0..=1,
        require_equals = true,
        value_delimiter = ',',
        default_missing_value = "",
    )]
    methods: Option<Vec<String>>,
    /// Trace these rays through this model (.obj, .ply, .stl, .gltf, .glb, .off, .3mf) instead, such as --write wrote
    /// them or any others.
    #[arg(
        long,
        num_args = 2,
        value_names = ["MODEL", "RAYS.npz"],
        conflicts_with_all = ["kinds", "list", "seed", "rays", "methods", "write"],
    )]
    replay: Option<Vec<PathBuf>>,
    /// With --replay: any hit within the limits will do, as for shadows.
    #[arg(long, requires = "replay", conflicts_with = "ask")]
    any_hit: bool,
    /// Instead of the kinds, aim at edges and vertices of closed meshes: count the rays that slip through, which must
    /// hit for a reason that needs no exact answer. Models that are not closed are named and left out.
    #[arg(
        long,
        num_args = 1..,
        value_name = "MODEL",
        conflicts_with_all = ["kinds", "list", "ask", "strict", "methods", "replay"],
    )]
    closed: Option<Vec<PathBuf>>,
    /// Write the rays with wrong answers and their meshes to this folder, and say how to trace them again.
    #[arg(long, value_name = "DIR")]
    pub(super) write: Option<PathBuf>,
    /// Write the counts to a JSON file. On the way there what is found is kept in FILE.partial.
    #[arg(long, value_name = "FILE")]
    pub(super) json: Option<PathBuf>,
    #[command(flatten)]
    keep: KeepArgs,
    #[command(flatten)]
    limit: LimitArgs,
    #[command(flatten)]
    pub(super) method: MethodArgs,
    #[command(flatten)]
    pub(super) device: DeviceArgs,
    #[command(flatten)]
    pub(super) memory: MemoryArgs,
}

/// Wrong answers of one method to the rays of one kind.
#[derive(Clone, Serialize)]
struct Row {
    kind: String,
    rays: usize,
    wrong: usize,
    /// How many hits the lists or walks have.
    #[serde(skip_serializing_if = "Option::is_none")]
    hits: Option<usize>,
    /// By [`Question::faults`].
    faults: serde_json::Map<String, serde_json::Value>,
}

/// Wrong answers of one method.
#[derive(Clone, Serialize)]
struct Sheet {
    method: String,
    options: TraceOptions,
    strict: bool,
    rays: usize,
    wrong: usize,
    wrong_per_million: f64,
    #[serde(skip)]
    question: Question,
    kinds: Vec<Row>,
}

/// What `--json` writes.
#[derive(Serialize)]
struct Report {
    seed: Option<u64>,
    device: String,
    asked: &'static str,
    /// False where the run was stopped: these are the kinds until then.
    finished: bool,
    methods: Vec<Sheet>,
}

/// Writes `report` of a run that is stopped. That it cannot be written is told, but changes nothing.
pub(super) fn keep(path: &Path, report: &impl Serialize) {
    if let Err(error) = write_json(path, report) {
        print::error(&error);
    }
}

/// Where and how to trace.
struct Run<'a> {
    args: &'a StressArgs,
    talk: Talk,
    device: Option<DeviceHandle>,
    cache: Option<Cache>,
    /// Of each kind.
    rays: usize,
    limit: Limit,
}

pub fn run(args: &StressArgs, talk: Talk) -> Result<Code> {
    if args.list {
        for kind in every_kind() {
            say!("{:16} {}", kind.name, kind.about);
        }
        return Ok(SUCCESS);
    }
    let limit = args.limit.begin(Instant::now());
    check_keep(args, limit)?;
    let options = args.method.options(StructureKind::Kd, false)?;
    if let Some(models) = &args.closed {
        return closed::run(args, models, talk);
    }
    let mut methods = match &args.methods {
        None => vec![Method { name: options.intersector.name().into(), options }],
        Some(names) if names.iter().all(String::is_empty) => Method::all(options),
        Some(names) => names.iter().map(|name| method_named(name, options)).collect::<Result<_>>()?,
    };
    let kinds = chosen_kinds(args)?;
    claim(args, &kinds, &methods)?;
    args.json.as_deref().map_or(Ok(()), check_writable)?;
    let device = open::choose(&args.device, talk)?;
    if args.methods.is_none() {
        methods[0].options = args.method.options_for(device.as_ref(), false, talk)?;
    }
    let cache = args.device.cache()?;
    let rays = args.rays.unwrap_or(DEFAULT_RAYS);
    if rays > MAX_RAYS {
        let message = format!("{rays} is more than {MAX_RAYS} of each kind; other rays come from another --seed");
        return Err(Error::option("--rays", message));
    }
    let run = Run { args, talk, device, cache, rays: rays as usize, limit };
    let mut sheets: Vec<Sheet> = methods.iter().map(|method| run.sheet(method)).collect();
    let done = match &args.replay {
        Some(files) => run.replay(files, &methods[0], &mut sheets[0]).map(|()| None),
        None => run.all_kinds(&kinds, &methods, &mut sheets),
    };
    let keeper = match done {
        Err(Error::Stopped) if limit.is_over() => return Ok(limit.end(talk)),
        Err(error) => {
            stop::work_now();
            return Err(error);
        }
        Ok(keeper) => keeper,
    };
    let wrong: usize = sheets.iter().map(|sheet| sheet.wrong).sum();
    if let Some(path) = &args.json {
        let report = run.report(sheets, true);
        stop::finish(|| write_json(path, &report))?;
    }
    keeper.map_or(Ok(()), StressKeeper::finish)?;
    Ok(if wrong == 0 { SUCCESS } else { FOUND_A_DIFFERENCE })
}

/// Checks that there is a place for what is to be kept.
fn check_keep(args: &StressArgs, limit: Limit) -> Result<()> {
    let has_place = args.json.is_some() && args.closed.is_none() && args.replay.is_none();
    let message = "what is found is kept beside the file of --json, and neither with --closed nor with --replay";
    match args.keep.is_given() {
        _ if has_place => Ok(()),
        Some(option) => Err(Error::option(option, message)),
        None if limit.is_set() => Err(Error::option(limit.option(), message)),
        None => Ok(()),
    }
}

/// Checks that nothing is written that is read, or written twice.
fn claim(args: &StressArgs, kinds: &[&Kind], methods: &[Method]) -> Result<()> {
    let mut files = Files::default();
    for path in args.replay.iter().flatten() {
        files.read(path, "what --replay traces");
    }
    files.write_if(args.json.as_deref(), "--json")?;
    refuse_journal(args.json.as_deref(), "--json")?;
    let journal = args.json.as_deref().map(|path| journal_of(path, None));
    files.write_if(journal.as_deref(), "--json, on its way,")?;
    let Some(folder) = &args.write else { return Ok(()) };
    let rays = args.rays.unwrap_or(DEFAULT_RAYS) as usize;
    for (kind, scene) in kinds.iter().flat_map(|kind| (0..kind.scene_count(rays)).map(move |scene| (kind, scene))) {
        let written = methods.iter().map(|method| replay_of(folder, kind, scene, args, method));
        let mut written: Vec<_> = written.collect();
        // All methods have the same mesh.
        written.dedup_by(|a, b| a.mesh == b.mesh && a.rays == b.rays);
        if let Some(first) = written.first() {
            files.write(&first.mesh, "--write")?;
        }
        written.iter().try_for_each(|replay| files.write(&replay.rays, "--write"))?;
    }
    Ok(())
}

/// The files of the rays of a scene of `kind` that a method gets wrong.
fn replay_of(folder: &Path, kind: &Kind, scene: usize, args: &StressArgs, method: &Method) -> Replay {
    let of_scene = if scene == 0 { String::new() } else { format!("-{scene}") };
    let mesh = format!("{}-{}{of_scene}", kind.name, args.seed);
    let of_question = if args.ask == Question::Closest { String::new() } else { format!("-{}", args.ask.name()) };
    Replay::in_folder(folder, &mesh, &format!("{mesh}-{}{of_question}", method.name))
}

fn chosen_kinds(args: &StressArgs) -> Result<Vec<&'static Kind>> {
    if args.kinds.iter().any(|name| name == "all") {
        return Ok(args.ask.kinds().collect());
    }
    args.kinds.iter().map(|name| Kind::find(name)).collect()
}

impl Run<'_> {
    fn sheet(&self, method: &Method) -> Sheet {
        Sheet {
            method: method.name.clone(),
            options: method.options,
            // The exact test promises as much.
            strict: self.args.strict
                || self.args.ask != Question::Closest
                || method.options.intersector == Intersector::Exact,
            rays: 0,
            wrong: 0,
            wrong_per_million: 0.0,
            question: self.args.ask,
            kinds: Vec::new(),
        }
    }

    fn device_name(&self) -> &str {
        self.device.as_ref().map_or("reference", |device| &device.info.name)
    }

    fn report(&self, methods: Vec<Sheet>, finished: bool) -> Report {
        let device = self.device_name().to_owned();
        let seed = self.args.replay.is_none().then_some(self.args.seed);
        Report { seed, device, asked: self.args.ask.name(), finished, methods }
    }

    /// What the answers of this run depend on.
    fn id(&self, kinds: &[&Kind], methods: &[Method], sheets: &[Sheet]) -> StressId {
        StressId {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            seed: self.args.seed,
            rays: self.rays,
            question: self.args.ask.name().to_owned(),
            kinds: kinds.iter().map(|kind| kind.name.to_owned()).collect(),
            methods: methods.iter().map(|method| format!("{}: {:?}", method.name, method.options)).collect(),
            strict: sheets.iter().map(|sheet| sheet.strict).collect(),
            device: self.device_name().to_owned(),
            compiler_options: self.args.device.compiler.compiler_options.clone(),
            write: self.args.write.as_ref().map(|folder| folder.display().to_string()),
        }
    }

    /// Judges every kind. What is found is kept, and returned where there is a place for it.
    fn all_kinds(&self, kinds: &[&Kind], methods: &[Method], sheets: &mut [Sheet]) -> Result<Option<StressKeeper>> {
        let table = Table { methods, question: self.args.ask, is_wide: self.args.methods.is_some() };
        let mut commands = Vec::new();
        let of = kinds.iter().map(|kind| kind.scene_count(self.rays)).sum();
        let open = |output: &PathBuf| {
            let id = self.id(kinds, methods, sheets);
            StressKeeper::open((&self.args.keep, self.limit), output, (id, of), self.talk)
        };
        let keeper = self.args.json.as_ref().map(open).transpose()?;
        self.before_stop(keeper.as_ref(), sheets);
        if !self.talk.quiet {
            table.say_head();
        }
        for kind in kinds {
            let (mut counts, mut hits) = (vec![Counts::new(); methods.len()], None);
            for scene in 0..kind.scene_count(self.rays) {
                let cell = self.cell((kind, scene), methods, (sheets, keeper.as_ref()))?;
                hits = cell.hits.map(|count| count + hits.unwrap_or(0));
                for (sums, of_method) in counts.iter_mut().zip(&cell.faults) {
                    of_method.iter().for_each(|(fault, count)| *sums.entry(fault.clone()).or_default() += count);
                }
                commands.extend(cell.commands);
            }
            for (sheet, counts) in sheets.iter_mut().zip(&counts) {
                sheet.add(kind.name, (self.rays, hits), counts);
            }
            self.before_stop(keeper.as_ref(), sheets);
            if !self.talk.quiet {
                table.say_row(kind.name, sheets.iter().filter_map(|sheet| sheet.kinds.last()));
            }
        }
        if !self.talk.quiet {
            table.say_foot(sheets);
            for command in &commands {
                say!("{command}");
            }
        }
        Ok(keeper)
    }

    /// Has the report of what is finished be written, and told what is kept, where the run is stopped.
    fn before_stop(&self, keeper: Option<&StressKeeper>, sheets: &[Sheet]) {
        let Some(path) = self.args.json.clone() else { return };
        let report = self.report(sheets.to_vec(), false);
        let last_words = keeper.map(|keeper| keeper.last_words(self.talk));
        stop::before_stop(move || {
            // No report of nothing takes the place of one that is there.
            if report.methods.iter().any(|sheet| !sheet.kinds.is_empty()) {
                keep(&path, &report);
            }
            last_words.into_iter().for_each(|work| work());
        });
    }

    /// What all methods make of one scene of a kind: it is kept, or found now.
    fn cell(
        &self,
        (kind, scene): (&Kind, usize),
        methods: &[Method],
        (sheets, keeper): (&[Sheet], Option<&StressKeeper>),
    ) -> Result<Cell> {
        if let Some(cell) = keeper.and_then(|keeper| keeper.kept(kind.name, scene)) {
            return Ok(cell.clone());
        }
        if self.limit.is_over() {
            return Err(Error::Stopped);
        }
        let case = kind.case_of_scene(self.args.seed, self.rays, scene);
        let exact = Exact::new(self.args.ask, &case);
        let hits = exact.hit_count(&case);
        let mut cell = Cell { kind: kind.name.to_owned(), scene, hits, ..Cell::default() };
        for (method, sheet) in methods.iter().zip(sheets) {
            let given = exact.ask(&case, &method.options, self.device.as_ref(), self.cache.as_ref())?;
            let faults = exact.faults(&given, sheet.strict);
            if let Some(folder) = self.args.write.as_deref().filter(|_| !faults.is_empty()) {
                cell.commands.push(self.write(folder, (kind, scene), &case, method, &faults)?);
            }
            cell.faults.push(counts_of(&faults));
        }
        keeper.map_or(Ok(()), |keeper| keeper.take(&cell))?;
        Ok(cell)
    }

    /// Writes the rays that went wrong, and tells how to trace them again.
    fn write(
        &self,
        folder: &Path,
        (kind, scene): (&Kind, usize),
        case: &Case,
        method: &Method,
        faults: &[(usize, Fault)],
    ) -> Result<String> {
        let numbers: Vec<usize> = faults.iter().map(|&(i, _)| i).collect();
        let replay = replay_of(folder, kind, scene, self.args, method);
        replay.write(case, &numbers)?;
        Ok(replay_command(&replay, case.any_hit, method, self.args))
    }

    /// Traces rays from files and shows each answer that is wrong beside the exact one.
    fn replay(&self, files: &[PathBuf], method: &Method, sheet: &mut Sheet) -> Result<()> {
        let [mesh, rays] = files else {
            return Err(Error::option("--replay", "needs a model and a file of rays"));
        };
        let budget = self.args.memory.budget();
        let scene = scene::load_within(mesh, &budget)?;
        let mut files_read = Files::default();
        files_read.read_scene(&scene);
        files_read.write_if(self.args.json.as_deref(), "--json")?;
        let read = Replay { mesh: mesh.clone(), rays: rays.clone() }.case_of(&scene, &budget)?;
        let case = Case { any_hit: self.args.any_hit, ..read };
        let exact = Exact::new(self.args.ask, &case);
        let given = exact.ask(&case, &method.options, self.device.as_ref(), self.cache.as_ref())?;
        let faults = exact.faults(&given, sheet.strict);
        sheet.add(&rays.display().to_string(), (case.rays.len(), exact.hit_count(&case)), &counts_of(&faults));
        if self.talk.quiet {
            return Ok(());
        }
        for &(i, fault) in &faults {
            say!("ray {i}: {}", fault.name());
            asked::say_answers(&exact, &given, i);
        }
        say!("{} of {} rays wrong", sheet.wrong, sheet.rays);
        Ok(())
    }
}

/// How many wrong answers there are of each sort.
fn counts_of(faults: &[(usize, Fault)]) -> Counts {
    let mut counts = Counts::new();
    faults.iter().for_each(|(_, fault)| *counts.entry(fault.name().to_owned()).or_default() += 1);
    counts
}

/// One of `--methods`.
fn method_named(name: &str, options: TraceOptions) -> Result<Method> {
    Method::parse(name, options).map_err(|error| match error {
        Error::Option { option, message } if option == "method" => Error::option("methods", message),
        other => other,
    })
}

/// What traces written rays again.
pub(super) fn replay_command(replay: &Replay, any_hit: bool, method: &Method, args: &StressArgs) -> String {
    let mut words = vec!["raybrook stress --replay".to_owned()];
    words.extend([&replay.mesh, &replay.rays].map(|path| path.display().to_string()));
    words.extend(flags::arguments(&method.options));
    words.extend((args.ask != Question::Closest).then(|| format!("--ask {}", args.ask.name())));
    words.extend(any_hit.then(|| "--any-hit".to_owned()));
    words.extend(args.strict.then(|| "--strict".to_owned()));
    words.extend(args.device.device.iter().map(|name| format!("--device '{name}'")));
    words.extend(args.device.compiler.compiler_options.iter().map(|o| format!("--compiler-options '{o}'")));
    words.join(" ")
}

impl Sheet {
    fn add(&mut self, kind: &str, (rays, hits): (usize, Option<usize>), counts: &Counts) {
        let count = |sort: Fault| counts.get(sort.name()).copied().unwrap_or(0);
        let wrong: usize = counts.values().sum();
        self.kinds.push(Row {
            kind: kind.to_owned(),
            rays,
            wrong,
            hits,
            faults: self.question.faults().iter().map(|&sort| (sort.name().to_owned(), count(sort).into())).collect(),
        });
        self.rays += rays;
        self.wrong += wrong;
        self.wrong_per_million = 1e6 * self.wrong as f64 / self.rays as f64;
    }
}
