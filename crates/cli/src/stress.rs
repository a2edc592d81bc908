//! `raybrook stress`: hard rays with exact answers, and how many of them a method gets wrong.

use super::code::{Code, FOUND_A_DIFFERENCE, SUCCESS};
use super::files::Files;
use super::values::Named;
use super::{DeviceArgs, MemoryArgs, MethodArgs, Talk, asked, closed, flags, open, print, stop};
use clap::builder::{PossibleValue, StringValueParser};
use raybrook::low_level::device::{Cache, DeviceHandle};
use raybrook::low_level::options::{Intersector, StructureKind, TraceOptions};
use raybrook::low_level::output::{check_writable, write_json};
use raybrook::low_level::scene;
use raybrook::{Error, Result};
use raybrook_lab::stress::{Case, Exact, Fault, Kind, Method, Question, Replay};
use serde::Serialize;
use std::path::{Path, PathBuf};

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
    #[arg(long, value_name = "NAMES", num_args = 0..=1, require_equals = true, value_delimiter = ',', default_missing_value = "")]
    methods: Option<Vec<String>>,
    /// Trace these rays through this model (.obj, .ply, .stl, .gltf, .glb, .off, .3mf) instead, such as --write wrote them or any others.
    #[arg(long, num_args = 2, value_names = ["MODEL", "RAYS.npz"], conflicts_with_all = ["kinds", "list", "seed", "rays", "methods", "write"])]
    replay: Option<Vec<PathBuf>>,
    /// With --replay: any hit within the limits will do, as for shadows.
    #[arg(long, requires = "replay", conflicts_with = "ask")]
    any_hit: bool,
    /// Instead of the kinds, aim at edges and vertices of closed models: count the rays that slip through, which must
    /// hit for a reason that needs no exact answer. Models that are not closed are named and left out.
    #[arg(long, num_args = 1.., value_name = "MODEL", conflicts_with_all = ["kinds", "list", "ask", "strict", "methods", "replay"])]
    closed: Option<Vec<PathBuf>>,
    /// Write the rays with wrong answers and their meshes to this folder, and say how to trace them again.
    #[arg(long, value_name = "DIR")]
    pub(super) write: Option<PathBuf>,
    /// Write the counts to a JSON file.
    #[arg(long, value_name = "FILE")]
    pub(super) json: Option<PathBuf>,
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
}

pub fn run(args: &StressArgs, talk: Talk) -> Result<Code> {
    if args.list {
        for kind in every_kind() {
            say!("{:16} {}", kind.name, kind.about);
        }
        return Ok(SUCCESS);
    }
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
    let run = Run { args, talk, device, cache, rays: rays as usize };
    let mut sheets: Vec<Sheet> = methods.iter().map(|method| run.sheet(method)).collect();
    let done = match &args.replay {
        Some(files) => run.replay(files, &methods[0], &mut sheets[0]),
        None => run.all_kinds(&kinds, &methods, &mut sheets),
    };
    if done.is_err() {
        stop::work_now();
    }
    done?;
    let wrong: usize = sheets.iter().map(|sheet| sheet.wrong).sum();
    if let Some(path) = &args.json {
        let report = run.report(sheets, true);
        stop::finish(|| write_json(path, &report))?;
    }
    Ok(if wrong == 0 { SUCCESS } else { FOUND_A_DIFFERENCE })
}

/// Checks that nothing is written that is read, or written twice.
fn claim(args: &StressArgs, kinds: &[&Kind], methods: &[Method]) -> Result<()> {
    let mut files = Files::default();
    for path in args.replay.iter().flatten() {
        files.read(path, "what --replay traces");
    }
    files.write_if(args.json.as_deref(), "--json")?;
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

    fn report(&self, methods: Vec<Sheet>, finished: bool) -> Report {
        let device = self.device.as_ref().map_or("reference", |device| &device.info.name).to_owned();
        let seed = self.args.replay.is_none().then_some(self.args.seed);
        Report { seed, device, asked: self.args.ask.name(), finished, methods }
    }

    fn all_kinds(&self, kinds: &[&Kind], methods: &[Method], sheets: &mut [Sheet]) -> Result<()> {
        let table = Table { methods, question: self.args.ask, is_wide: self.args.methods.is_some() };
        let mut commands = Vec::new();
        if !self.talk.quiet {
            table.say_head();
        }
        for kind in kinds {
            let mut faults = vec![Vec::new(); methods.len()];
            let mut hits = None;
            for (scene, case) in kind.cases(self.args.seed, self.rays).enumerate() {
                let exact = Exact::new(self.args.ask, &case);
                hits = exact.hit_count(&case).map(|count| count + hits.unwrap_or(0));
                for ((method, sheet), faults) in methods.iter().zip(&*sheets).zip(&mut faults) {
                    let given = exact.ask(&case, &method.options, self.device.as_ref(), self.cache.as_ref())?;
                    let of_case = exact.faults(&given, sheet.strict);
                    if let Some(folder) = self.args.write.as_deref().filter(|_| !of_case.is_empty()) {
                        commands.push(self.write(folder, (kind, scene), &case, method, &of_case)?);
                    }
                    faults.extend(of_case);
                }
            }
            for (sheet, faults) in sheets.iter_mut().zip(&faults) {
                sheet.add(kind.name, (self.rays, hits), faults);
            }
            if let Some(path) = self.args.json.clone() {
                let report = self.report(sheets.to_vec(), false);
                stop::before_stop(move || keep(&path, &report));
            }
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
        Ok(())
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
        sheet.add(&rays.display().to_string(), (case.rays.len(), exact.hit_count(&case)), &faults);
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
    fn add(&mut self, kind: &str, (rays, hits): (usize, Option<usize>), faults: &[(usize, Fault)]) {
        let count = |sort: Fault| faults.iter().filter(|&&(_, fault)| fault == sort).count();
        self.kinds.push(Row {
            kind: kind.to_owned(),
            rays,
            wrong: faults.len(),
            hits,
            faults: self.question.faults().iter().map(|&sort| (sort.name().to_owned(), count(sort).into())).collect(),
        });
        self.rays += rays;
        self.wrong += faults.len();
        self.wrong_per_million = 1e6 * self.wrong as f64 / self.rays as f64;
    }
}

/// Counts in columns: the sorts of one method's faults, or wrong answers by method.
struct Table<'a> {
    methods: &'a [Method],
    question: Question,
    is_wide: bool,
}

impl Table<'_> {
    const SORT_WIDTH: usize = 7;

    fn method_width(method: &Method) -> usize {
        method.name.chars().count().max(Self::SORT_WIDTH)
    }

    fn say_head(&self) {
        let columns: String = if self.is_wide {
            self.methods.iter().map(|m| format!(" {:>1$}", m.name, Self::method_width(m))).collect()
        } else {
            self.question.faults().iter().map(|sort| format!(" {:>1$}", sort.name(), Self::SORT_WIDTH)).collect()
        };
        let wrong = if self.is_wide { "" } else { "   wrong" };
        let hits = if self.question == Question::Closest { "" } else { "      hits" };
        say!("{:16} {:>8}{hits}{wrong}{columns}", "kind", "rays");
    }

    fn say_row<'r>(&self, kind: &str, rows: impl Iterator<Item = &'r Row>) {
        let mut line = String::new();
        for (row, method) in rows.zip(self.methods) {
            if line.is_empty() {
                line = format!("{kind:16} {:>8}", row.rays);
                line += &row.hits.map_or_else(String::new, |hits| format!(" {hits:>9}"));
            }
            if self.is_wide {
                line += &format!(" {:>1$}", row.wrong, Self::method_width(method));
            } else {
                line += &format!(" {:>1$}", row.wrong, Self::SORT_WIDTH);
                for count in row.faults.values() {
                    let text = if *count == 0 { String::new() } else { count.to_string() };
                    line += &format!(" {text:>0$}", Self::SORT_WIDTH);
                }
            }
        }
        say!("{}", line.trim_end());
    }

    fn say_foot(&self, sheets: &[Sheet]) {
        if !self.is_wide {
            let sheet = &sheets[0];
            say!("{} wrong of {} rays, {:.1} per million", sheet.wrong, sheet.rays, sheet.wrong_per_million);
            return;
        }
        let columns = |text: &dyn Fn(&Sheet) -> String| -> String {
            let pairs = sheets.iter().zip(self.methods);
            pairs.map(|(sheet, method)| format!(" {:>1$}", text(sheet), Self::method_width(method))).collect()
        };
        let width = if self.question == Question::Closest { 25 } else { 35 };
        say!("{:width$}{}", "wrong", columns(&|sheet| sheet.wrong.to_string()));
        say!("{:width$}{}", "per million", columns(&|sheet| format!("{:.0}", sheet.wrong_per_million)));
    }
}
