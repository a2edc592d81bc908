//! `--explain`: what was chosen for a scene, and why; and the choice itself, which asks for it.

use super::flags::in_flags;
use super::open::Loaded;
use super::{DeviceArgs, MethodArgs, Talk, heading};
use raybrook::Result;
use raybrook::low_level::choose::tune::{DeviceKey, TunedFile};
use raybrook::low_level::choose::{Chosen, Decision, Source, TunedChoice, Workload};
use raybrook::low_level::device::{DeviceHandle, cache_folder};
use raybrook::low_level::stats::RunStats;
use raybrook::low_level::tracer::Spent;

#[derive(clap::Args)]
pub struct ExplainArgs {
    /// Print the automatic choices and their reasons.
    ///
    /// On standard error: structure, packet size, triangle test, numbers of the build, features of the kernels,
    /// work-group size, and of pictures the camera; given on the command line, by the scene, tuned for the device by
    /// `raybrook tune`, or by the program's model. Of pictures also what took how long.
    #[arg(long, help_heading = heading::OUTPUT)]
    explain: bool,
}

impl ExplainArgs {
    /// Prints one line for each choice, if that is asked for.
    pub fn print(&self, decisions: &[Decision], talk: Talk) {
        if !self.explain || talk.quiet {
            return;
        }
        for decision in decisions {
            match decision.source {
                Source::Given => tell!("{decision} on the command line"),
                _ => tell!("{decision}"),
            }
        }
    }

    /// Prints what took how long, the longest first, if that is asked for; without what `earlier` runs took.
    pub fn print_times(&self, stats: &RunStats, earlier: &Spent, talk: Talk) {
        if self.explain && !talk.quiet {
            tell!("{}", times(stats, earlier));
        }
    }
}

/// Parts of a run that took at least a hundredth of it, the longest first.
fn times(stats: &RunStats, earlier: &Spent) -> String {
    let parts = stats.parts(earlier);
    let shown = parts.iter().filter(|(_, seconds)| *seconds >= 0.01 * stats.total_s);
    let shown: Vec<String> = shown.map(|(name, seconds)| format!("{name} {seconds:.3} s")).collect();
    format!("time: {:.3} s: {}", stats.total_s, shown.join(", "))
}

/// What the methods for a scene depend on, beside the scene.
pub struct Chooser<'a> {
    pub method: &'a MethodArgs,
    pub counters: bool,
    /// Whether pictures are made of it, not only hits.
    pub pictures: bool,
    /// Whether closest points are asked for, and no rays.
    pub points: bool,
    pub device: Option<&'a DeviceHandle>,
    pub device_args: &'a DeviceArgs,
    pub explain: &'a ExplainArgs,
    pub talk: Talk,
}

impl<'a> Chooser<'a> {
    /// For hits alone, which are not counted.
    pub fn new(
        (method, device_args, explain): (&'a MethodArgs, &'a DeviceArgs, &'a ExplainArgs),
        device: Option<&'a DeviceHandle>,
        talk: Talk,
    ) -> Chooser<'a> {
        Chooser { method, counters: false, pictures: false, points: false, device, device_args, explain, talk }
    }

    /// Chooses what the user leaves open, and explains it, and the camera, if that is asked for.
    pub fn choose(&self, Loaded { scene, camera, .. }: &Loaded) -> Result<Chosen> {
        let info = self.device.map(|device| &device.info);
        let workload = Workload { points: self.points, ..Workload::of_scene(info, scene, self.pictures) };
        let tuned = workload.triangle_count.and_then(|count| self.tuned(count));
        let mut chosen = self.method.choose(&workload, tuned.as_ref(), self.counters, self.talk)?;
        chosen.decisions.extend_from_slice(camera);
        self.explain.print(&chosen.decisions, self.talk);
        if self.explain.explain
            && !self.talk.quiet
            && let Some(why) = workload.slower_than_exact(&chosen.options)
        {
            tell!("warning: {}", in_flags(&why));
        }
        Ok(chosen)
    }

    /// What `raybrook tune` has found, where it matters and is not to be ignored.
    fn tuned(&self, triangle_count: usize) -> Option<TunedChoice> {
        if self.device_args.no_cache || !self.method.leaves_a_choice() {
            return None;
        }
        let key = DeviceKey::new(self.device.map(|device| &device.info));
        TunedFile::in_folder(cache_folder()?).find(&key, triangle_count).unwrap_or_else(|why| {
            if !self.talk.quiet {
                tell!("note: {}", in_flags(&why));
            }
            None
        })
    }
}
