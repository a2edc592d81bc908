//! `raybrook stress --closed`: rays at edges and vertices of closed models, and how many of them slip through.

use super::progress::Bar;
use super::stress::{StressArgs, replay_command};
use super::{Talk, open};
use raybrook::device::{Cache, DeviceHandle};
use raybrook::options::TraceOptions;
use raybrook::output::{check_writable, write_json};
use raybrook::scene;
use raybrook::stress::closed::{ClosedMesh, Leaks, NotClosed, find_leaks};
use raybrook::stress::{Case, Mesh, Method, Replay, StressRay};
use raybrook::{Error, Result};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

/// Rays of all models together unless told otherwise.
const DEFAULT_RAYS: u64 = 1_000_000;

/// What became of one model's rays.
#[derive(Serialize)]
struct Row {
    model: String,
    triangles: usize,
    edges: usize,
    #[serde(flatten)]
    leaks: Leaks,
}

/// What `--json` writes.
#[derive(Serialize)]
struct Report {
    seed: u64,
    device: String,
    options: TraceOptions,
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
#[derive(Serialize)]
struct Skipped {
    model: String,
    #[serde(flatten)]
    why: NotClosed,
}

/// The file's name, or all of the path where that is no name.
fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

pub fn run(args: &StressArgs, models: &[PathBuf], talk: Talk) -> Result<ExitCode> {
    let start = Instant::now();
    args.json.as_deref().map_or(Ok(()), check_writable)?;
    let device = open::choose(&args.device, talk)?;
    let options = args.method.options_for(device.as_ref(), false, talk)?;
    let cache = args.device.cache()?;
    let (mut closed, mut not_closed) = (Vec::new(), Vec::new());
    for path in models {
        match ClosedMesh::new(Mesh::try_from(&scene::load(path)?)?) {
            Ok(mesh) => closed.push((name_of(path), mesh)),
            Err(why) => not_closed.push((path, why)),
        }
    }
    if let ([], Some((path, why))) = (&closed[..], not_closed.first()) {
        return Err(Error::input(path, None, why.to_string()));
    }
    if !talk.quiet {
        for (path, why) in &not_closed {
            say!("left out: {}: {why}", name_of(path));
        }
    }
    let run = Run { args, options, talk, device, cache };
    let models = run.all(&closed)?;
    let sum = |count: fn(&Leaks) -> u64| models.iter().map(|row| count(&row.leaks)).sum::<u64>();
    let (rays, misses, behind) = (sum(|l| l.rays), sum(|l| l.misses), sum(|l| l.behind));
    let total_s = start.elapsed().as_secs_f64();
    let device = run.device.as_ref().map_or("reference", |device| &device.info.name).to_owned();
    if !talk.quiet {
        say!(
            "{rays} rays on {device}, {total_s:.1} s: {misses} hit nothing, {behind} something behind what they must hit"
        );
    }
    if let Some(path) = &args.json {
        let second_pass = models.iter().map(|row| row.leaks.second_pass).sum();
        let skipped = |(path, why): &(&PathBuf, NotClosed)| Skipped { model: name_of(path), why: *why };
        let not_closed = not_closed.iter().map(skipped).collect();
        let seed = args.seed;
        let report = Report { seed, device, options, rays, misses, behind, second_pass, total_s, models, not_closed };
        write_json(path, &report)?;
    }
    Ok(if misses + behind == 0 { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

struct Run<'a> {
    args: &'a StressArgs,
    options: TraceOptions,
    talk: Talk,
    device: Option<DeviceHandle>,
    cache: Option<Cache>,
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
            let bar = Bar::new(name.clone(), self.talk);
            let millions = rays as f64 / 1e6;
            let leaks = find_leaks(
                mesh,
                &self.options,
                self.device.as_ref(),
                self.cache.as_ref(),
                // Other rays for each model, the same ones whichever models there are.
                self.args.seed ^ u64::from(crc32fast::hash(name.as_bytes())) << 32,
                rays,
                &|done| bar.update(done, millions, "M rays"),
            )?;
            drop(bar);
            let row =
                Row { model: name.clone(), triangles: mesh.mesh().triangles.len(), edges: mesh.edge_count(), leaks };
            if !self.talk.quiet {
                row.say();
            }
            if let Some(folder) = self.args.write.as_deref().filter(|_| !row.leaks.wrong.is_empty()) {
                commands.push(self.write(folder, name, mesh, &row.leaks)?);
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

    /// Writes the rays that went wrong, and tells how to trace them again.
    fn write(&self, folder: &Path, name: &str, mesh: &ClosedMesh, leaks: &Leaks) -> Result<String> {
        let rays: Vec<StressRay> = leaks.wrong.iter().map(|&(ray, _)| ray).collect();
        let numbers: Vec<usize> = (0..rays.len()).collect();
        let case = Case { mesh: mesh.mesh().clone(), rays };
        let method = Method { name: self.options.intersector.name().into(), options: self.options };
        let mesh_name = format!("closed-{}", name.replace('.', "-"));
        let rays_name = format!("{mesh_name}-{}-{}", self.args.seed, method.name);
        let replay = Replay::write(folder, &case, &numbers, &mesh_name, &rays_name)?;
        Ok(replay_command(&replay, &method, self.args))
    }
}

impl Row {
    fn say(&self) {
        let Row { model, triangles, leaks, .. } = self;
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
        if leaks.is_cut_short {
            say!("{model}: not all rays were traced: so many slip through that more tell no more");
        }
    }
}
