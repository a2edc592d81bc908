//! `raybrook stress --closed`: rays at edges and vertices of closed meshes, and how many of them slip through.

use super::code::{Code, FOUND_A_DIFFERENCE, SUCCESS};
use super::files::Files;
use super::progress::Bar;
use super::stress::{StressArgs, keep, replay_command};
use super::{Talk, open, stop};
use raybrook::low_level::budget::{DecidedBy, MemoryBudget, Need};
use raybrook::low_level::device::{Cache, DeviceHandle};
use raybrook::low_level::options::{StructureKind, TraceOptions};
use raybrook::low_level::output::{check_writable, write_json};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::scene::{self, Scene};
use raybrook::{Error, Result};
use raybrook_lab::stress::closed::{ClosedMesh, Leaks, NotClosed, find_leaks};
use raybrook_lab::stress::{Case, Mesh, Method, Replay, StressRay};
use serde::Serialize;
use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Rays of all models together unless told otherwise.
const DEFAULT_RAYS: u64 = 1_000_000;

/// What became of one model's rays.
#[derive(Clone, Serialize)]
struct Row {
    model: String,
    triangles: usize,
    edges: usize,
    /// Triangles as thin as a line.
    thin: usize,
    #[serde(flatten)]
    leaks: Leaks,
}

/// What `--json` writes.
#[derive(Clone, Serialize)]
struct Report {
    seed: u64,
    device: String,
    options: TraceOptions,
    /// False where the run was stopped: these are the rays until then.
    finished: bool,
    rays: u64,
    misses: u64,
    behind: u64,
    second_pass: Option<u64>,
    /// Seconds in all, with loading and builds.
    total_s: f64,
    models: Vec<Row>,
    not_closed: Vec<Skipped>,
}

/// A model that was left out.
#[derive(Clone, Serialize)]
struct Skipped {
    model: String,
    #[serde(flatten)]
    why: NotClosed,
}

/// A name for each model: its file's, or all of the path where that is no name or the name of a model before it.
fn names_of(models: &[PathBuf]) -> Vec<(String, PathBuf)> {
    let mut names: Vec<(String, PathBuf)> = Vec::new();
    for path in models {
        let short = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        let is_taken = names.iter().any(|(name, _)| plain(name) == plain(&short));
        let name = if is_taken { path.display().to_string() } else { short };
        names.push((name, path.clone()));
    }
    names
}

/// `name` as a part of the name of a file.
fn plain(name: &str) -> String {
    name.replace(['.', '/', '\\'], "-")
}

/// The names, without endings, of the files that [`StressArgs::write`] asks for: of the mesh and of the rays.
fn replay_names(name: &str, args: &StressArgs, method: &Method) -> (String, String) {
    let mesh = format!("closed-{}", plain(name));
    let rays = format!("{mesh}-{}-{}", args.seed, method.name);
    (mesh, rays)
}

fn method_of(options: TraceOptions) -> Method {
    Method { name: options.intersector.name().into(), options }
}

impl Report {
    fn new(args: &StressArgs, device: &str, options: TraceOptions, start: Instant) -> Report {
        Report {
            seed: args.seed,
            device: device.to_owned(),
            options,
            finished: false,
            rays: 0,
            misses: 0,
            behind: 0,
            second_pass: None,
            total_s: start.elapsed().as_secs_f64(),
            models: Vec::new(),
            not_closed: Vec::new(),
        }
    }

    /// The same with these models, and the sums of all.
    fn with(&self, models: Vec<Row>, start: Instant) -> Report {
        let sum = |count: fn(&Leaks) -> u64| models.iter().map(|row| count(&row.leaks)).sum::<u64>();
        let (rays, misses, behind) = (sum(|l| l.rays), sum(|l| l.misses), sum(|l| l.behind));
        let second_pass = models.iter().map(|row| row.leaks.second_pass).sum();
        let total_s = start.elapsed().as_secs_f64();
        Report { rays, misses, behind, second_pass, total_s, models, ..self.clone() }
    }
}

/// Keeps that the models are read, and checks that nothing is written over them, or twice.
fn claim(args: &StressArgs, names: &[(String, PathBuf)], mut files: Files) -> Result<()> {
    files.write_if(args.json.as_deref(), "--json")?;
    let Some(folder) = &args.write else { return Ok(()) };
    let method = method_of(args.method.options(StructureKind::Kd, false)?);
    for (name, _) in names {
        let (mesh, rays) = replay_names(name, args, &method);
        Replay::in_folder(folder, &mesh, &rays).files().iter().try_for_each(|path| files.write(path, "--write"))?;
    }
    Ok(())
}

/// Checks that there is memory for the structure over a model.
fn check_memory(path: &Path, scene: &Scene, options: &TraceOptions, budget: &MemoryBudget) -> Result<()> {
    budget.check(&Need {
        what: &format!("{}: `structure = {}` of {} triangles", path.display(), options.kind(), scene.triangle_count()),
        bytes: SceneBuffers::estimated_bytes(scene, options),
        decided_by: DecidedBy::Input,
        remedy: "take a model of fewer triangles, or raise --memory-limit",
    })
}

pub fn run(args: &StressArgs, models: &[PathBuf], talk: Talk) -> Result<Code> {
    let start = Instant::now();
    let mut files = Files::default();
    models.iter().for_each(|path| files.read(path, "a model"));
    let names = names_of(models);
    claim(args, &names, files.clone())?;
    args.json.as_deref().map_or(Ok(()), check_writable)?;
    let device = open::choose(&args.device, talk)?;
    let options = args.method.options_for(device.as_ref(), false, talk)?;
    let cache = args.device.cache()?;
    let budget = args.memory.budget();
    let (mut closed, mut not_closed) = (Vec::new(), Vec::new());
    for (name, path) in &names {
        let scene = scene::load_within(path, &budget)?;
        check_memory(path, &scene, &options, &budget)?;
        files.read_scene(&scene);
        match ClosedMesh::new(Mesh::try_from(&scene)?) {
            Ok(mesh) => closed.push((name.clone(), mesh)),
            Err(why) => not_closed.push((path, Skipped { model: name.clone(), why })),
        }
    }
    claim(args, &names, files)?;
    if let ([], Some((path, skipped))) = (&closed[..], not_closed.first()) {
        return Err(Error::input(path, None, skipped.why.to_string()));
    }
    let not_closed: Vec<Skipped> = not_closed.into_iter().map(|(_, skipped)| skipped).collect();
    if !talk.quiet {
        for Skipped { model, why } in &not_closed {
            say!("left out: {model}: {why}");
        }
    }
    let name = device.as_ref().map_or("reference", |device| &device.info.name).to_owned();
    let empty = Report { not_closed, ..Report::new(args, &name, options, start) };
    let run = Run { args, options, talk, device, cache, start, empty };
    let found = run.all(&closed);
    if found.is_err() {
        stop::work_now();
    }
    let report = Report { finished: true, ..run.empty.with(found?, start) };
    let Report { rays, misses, behind, total_s, .. } = report;
    if !talk.quiet {
        say!(
            "{rays} rays on {name}, {total_s:.1} s: {misses} hit nothing, {behind} something behind what they must hit"
        );
    }
    if let Some(path) = &args.json {
        stop::finish(|| write_json(path, &report))?;
    }
    Ok(if misses + behind == 0 { SUCCESS } else { FOUND_A_DIFFERENCE })
}

struct Run<'a> {
    args: &'a StressArgs,
    options: TraceOptions,
    talk: Talk,
    device: Option<DeviceHandle>,
    cache: Option<Cache>,
    start: Instant,
    /// The report without models.
    empty: Report,
}

impl Run<'_> {
    fn all(&self, closed: &[(String, ClosedMesh)]) -> Result<Vec<Row>> {
        let total = self.args.rays.unwrap_or(DEFAULT_RAYS);
        if !self.talk.quiet {
            say!(
                "{:24} {:>9} {:>12} {:>12} {:>12} {:>12} {:>7} {:>7} {:>8} {:>7}",
                "model",
                "triangles",
                "rays",
                "at vertices",
                "from inside",
                "whole",
                "miss",
                "behind",
                "Mrays/s",
                "s"
            );
        }
        let mut rows = Vec::new();
        let mut commands = Vec::new();
        for (i, (name, mesh)) in closed.iter().enumerate() {
            let (number, count) = (i as u64, closed.len() as u64);
            let rays = total * (number + 1) / count - total * number / count;
            let row = self.one(name, mesh, rays, &rows)?;
            if !self.talk.quiet {
                row.say();
            }
            if let Some(replay) = self.replay(name).filter(|_| !row.leaks.wrong.is_empty()) {
                commands.push(replay_command(&replay, false, &method_of(self.options), self.args));
            }
            rows.push(row);
        }
        if !self.talk.quiet {
            for command in &commands {
                say!("{command}");
            }
        }
        Ok(rows)
    }

    /// Traces one model's rays; what is found is kept as it comes, for a run that is stopped.
    fn one(&self, name: &str, mesh: &ClosedMesh, rays: u64, before: &[Row]) -> Result<Row> {
        let bar = Bar::new(name, self.talk);
        let row = |leaks: Leaks| Row {
            model: name.to_owned(),
            triangles: mesh.mesh().triangles.len(),
            edges: mesh.edge_count(),
            thin: mesh.thin_count(),
            leaks,
        };
        let written = Cell::new(0);
        let so_far = |leaks: &Leaks| {
            bar.update(leaks.rays as f64 / rays as f64, rays as f64 / 1e6, "M rays");
            if leaks.wrong.len() > written.replace(leaks.wrong.len()) {
                self.write(name, mesh, leaks)?;
            }
            if let Some(path) = self.args.json.clone() {
                let report = self.empty.with([before, &[row(leaks.clone())]].concat(), self.start);
                stop::before_stop(move || keep(&path, &report));
            }
            Ok(())
        };
        // Other rays for each model, the same ones whichever models there are.
        let seed = self.args.seed ^ u64::from(crc32fast::hash(name.as_bytes())) << 32;
        let (device, cache) = (self.device.as_ref(), self.cache.as_ref());
        find_leaks(mesh, &self.options, device, cache, seed, rays, &so_far).map(row)
    }

    /// The files of the rays that went wrong, if they are to be written.
    fn replay(&self, name: &str) -> Option<Replay> {
        let (mesh, rays) = replay_names(name, self.args, &method_of(self.options));
        self.args.write.as_ref().map(|folder| Replay::in_folder(folder, &mesh, &rays))
    }

    /// Writes the rays that went wrong.
    fn write(&self, name: &str, mesh: &ClosedMesh, leaks: &Leaks) -> Result<()> {
        let Some(replay) = self.replay(name) else { return Ok(()) };
        let rays: Vec<StressRay> = leaks.wrong.iter().map(|&(ray, _)| ray).collect();
        let numbers: Vec<usize> = (0..rays.len()).collect();
        replay.write(&Case { mesh: mesh.mesh().clone(), rays, any_hit: false }, &numbers)
    }
}

impl Row {
    fn say(&self) {
        let Row { model, triangles, thin, leaks, .. } = self;
        let whole = leaks.second_pass.map_or("-".into(), |rays| rays.to_string());
        say!(
            "{model:24} {triangles:>9} {:>12} {:>12} {:>12} {whole:>12} {:>7} {:>7} {:>8.2} {:>7.1}",
            leaks.rays,
            leaks.at_vertices,
            leaks.from_inside,
            leaks.misses,
            leaks.behind,
            leaks.rays as f64 / leaks.total_s / 1e6,
            leaks.total_s,
        );
        if *thin > 0 {
            say!("{model}: {thin} triangles are as thin as a line; every fourth ray is aimed into one of them");
        }
        if leaks.is_cut_short {
            say!("{model}: not all rays were traced: so many slip through that more tell no more");
        }
    }
}
