//! What commands that ask for points of a file have in common.

use super::explain::{Chooser, ExplainArgs};
use super::files::Files;
use super::loss::LossArgs;
use super::open::Opened;
use super::{DeviceArgs, MethodArgs, SceneArgs, Talk, open};
use raybrook::low_level::budget::{DecidedBy, MemoryBudget, Need};
use raybrook::low_level::choose::Chosen;
use raybrook::low_level::crossings::check_closed;
use raybrook::low_level::options::StructureKind;
use raybrook::low_level::output::check_writable;
use raybrook::low_level::rays::read_points;
use raybrook::low_level::tracer::Task;
use raybrook::{DeviceKind, Error, Result};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct PointArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// Points: the array `point` float32 [n,3].
    #[arg(value_name = "POINTS.npz")]
    points: PathBuf,
    #[command(flatten)]
    pub method: MethodArgs,
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    loss: LossArgs,
    #[command(flatten)]
    explain: ExplainArgs,
}

/// Points, and what answers them.
pub struct OpenedPoints {
    pub points: Vec<[f32; 3]>,
    pub opened: Opened,
    /// Whether a processor's device answers first.
    pub is_for_processor: bool,
    pub budget: MemoryBudget,
}

impl PointArgs {
    /// Reads points and scene, and opens the tracer for `tasks`, which may be none; each point may take so many bytes.
    pub fn open(&self, output: Option<&Path>, tasks: &[Task], bytes: usize, talk: Talk) -> Result<OpenedPoints> {
        let mut files = Files::default();
        files.read(&self.scene.scene, "the scene");
        files.read(&self.points, "the file of points");
        files.clone().write_if(output, "-o")?;
        if let Some(output) = output {
            check_writable(output)?;
        }
        // What asks no tracer waits for no device, unless one is named.
        let device = match tasks.is_empty() && self.device.device.is_none() {
            true => None,
            false => open::choose(&self.device, talk)?,
        };
        let budget = self.scene.memory.budget();
        let (points, ignored) = read_points(&self.points, &budget)?;
        if talk.verbose && !ignored.is_empty() {
            tell!("note: {}: arrays that mean nothing here: {}", self.points.display(), ignored.join(", "));
        }
        let loaded = open::load_for_rays(&self.scene.scene, self.scene.allow_empty, &budget, talk)?;
        files.read_scene(&loaded.scene);
        files.write_if(output, "-o")?;
        let chooser = Chooser::new((&self.method, &self.device, &self.explain), device.as_ref(), talk);
        let chosen = match tasks.is_empty() {
            true => self.method.options(StructureKind::Brute, false).map(Chosen::given)?,
            false => Chooser { points: tasks == [Task::Points], ..chooser }.choose(&loaded)?,
        };
        let opened = open::open(&loaded, device.as_ref(), &self.device, chosen, 1, (tasks, &budget), talk)?;
        let what = format!("finding {} points of {}", points.len(), self.points.display());
        let remedy = "split the points, or raise --memory-limit";
        let bytes = (points.len() * bytes) as u64;
        budget.check(&Need { what: &what, bytes, decided_by: DecidedBy::Input, remedy })?;
        let opened = self.loss.guard(opened, device.as_ref(), talk);
        let is_for_processor = device.is_some_and(|device| device.info.kind == DeviceKind::Cpu);
        Ok(OpenedPoints { points, opened, is_for_processor, budget })
    }

    /// Refuses a scene that is not closed.
    pub fn require_closed(&self, opened: &Opened) -> Result<()> {
        check_closed(&opened.buffers).map_err(|error| match error {
            Error::Scene(message) => Error::input(&self.scene.scene, None, message),
            other => other,
        })
    }
}
