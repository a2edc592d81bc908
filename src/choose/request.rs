//! Requests that leave choices open, and how they are made.
//!
//! Closest hits, and pixels, are the same whatever is chosen here, to the bit: only their time depends on it.

use super::model::{Workload, kernel_features};
use crate::accel::BuildOptions;
use crate::device::{who_decides, work_group_size};
use crate::error::{Error, Result};
use crate::options::{
    Choice, Decisions, Intersector, KdOptions, KernelFeatures, MethodOption, OPTIONS, PacketSize, Stop, Structure,
    StructureKind, TraceOptions, Value, parse_method,
};
use serde::Serialize;
use std::borrow::Cow;
use std::fmt;

/// Where a choice comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Source {
    /// Whoever asks has set it.
    Given,
    /// It was the fastest when it was measured on this device ([`super::tune`]).
    Tuned,
    /// The scene, or the rule of the format of its file.
    Scene,
    /// The model, or the default of a build.
    Model,
}

/// What measuring found to be the fastest for a device and scenes of one size; see [`super::tune`].
#[derive(Debug, Clone, PartialEq)]
pub struct TunedChoice {
    /// The structure.
    pub structure: StructureKind,
    /// How many rays are traced together in it.
    pub packet_size: PacketSize,
    /// How much faster it was than what the model takes, and on what; for people.
    pub reason: String,
}

/// One choice: what, and why.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Decision {
    /// The option, or words for what no option sets.
    pub option: Cow<'static, str>,
    /// The value in effect.
    pub value: String,
    /// Where it comes from.
    #[serde(rename = "origin")]
    pub source: Source,
    /// Why, for people; empty where it was given.
    pub reason: String,
}

/// As one line: `structure bvh8: model: the device is a CPU, ...`.
impl fmt::Display for Decision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Decision { option, value, reason, .. } = self;
        match self.source {
            Source::Given => write!(f, "{option} {value}: given"),
            Source::Tuned => write!(f, "{option} {value}: tuned for this device: {reason}"),
            Source::Scene => write!(f, "{option} {value}: scene: {reason}"),
            Source::Model => write!(f, "{option} {value}: model: {reason}"),
        }
    }
}

/// What is asked for; everything else is left to be chosen.
///
/// ```
/// use raybrook::low_level::choose::{Request, Source, Workload};
/// use raybrook::low_level::options::StructureKind;
///
/// # fn main() -> raybrook::Result<()> {
/// let workload = Workload { triangle_count: Some(5000), ..Workload::without_scene(None) };
/// let chosen = Request::default().choose(&workload, None)?;
/// assert_eq!(chosen.options.kind(), StructureKind::Kd); // the reference is fastest so in scenes of this size
/// assert!(chosen.decisions.iter().all(|decision| decision.source == Source::Model));
///
/// let mut request = Request::default();
/// request.set("grid_size", "4,4,4")?;
/// let chosen = request.choose(&workload, None)?;
/// assert_eq!(chosen.options.kind(), StructureKind::Grid); // nothing else reads the size of a grid
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Request {
    given: Vec<Choice>,
    counters: bool,
}

/// What came of a [`Request`].
#[derive(Debug, Clone)]
pub struct Chosen {
    /// Valid options.
    pub options: TraceOptions,
    /// What was chosen, and why. What the structure does not read is left out.
    pub decisions: Vec<Decision>,
    /// The limit that kept the fastest structure from being taken, where one did that nobody may have thought of.
    pub limit: Option<String>,
}

impl Chosen {
    /// What was not chosen, but asked for.
    pub fn given(options: TraceOptions) -> Chosen {
        Chosen { options, decisions: Vec::new(), limit: None }
    }
}

/// A value, where it comes from, and why.
type Sourced<T> = (T, Source, String);

fn given<T>(value: T) -> Sourced<T> {
    (value, Source::Given, String::new())
}

fn by_model<T>((value, reason): (T, String)) -> Sourced<T> {
    (value, Source::Model, reason)
}

fn decision<T: fmt::Display>(option: &'static str, (value, source, reason): Sourced<T>) -> Decision {
    Decision { option: option.into(), value: value.to_string(), source, reason }
}

impl Request {
    /// A request for the structure of `options`, which comes first, and for everything that is not its default.
    pub fn of(options: &TraceOptions) -> Request {
        let is_asked = |option: &&MethodOption| option.name == StructureKind::OPTION || option.is_set(options);
        let given = OPTIONS.iter().filter(is_asked).filter_map(|option| option.choice_in(options));
        Request { given: given.collect(), counters: options.counters }
    }

    /// Asks for a choice as well; of several of one option the last counts.
    pub fn give(&mut self, choice: Choice) {
        self.given.retain(|other| other.option().name != choice.option().name);
        self.given.push(choice);
    }

    /// Leaves `option` to be chosen again.
    pub fn leave(&mut self, option: &str) {
        self.given.retain(|choice| choice.option().name != option);
    }

    /// Asks for the value `text` of the option `name`, such as `leaf_size`.
    ///
    /// # Errors
    /// [`Error::Option`] when there is no such option or value.
    pub fn set(&mut self, name: &str, text: &str) -> Result<()> {
        let option =
            MethodOption::find(name).ok_or_else(|| Error::option(name, "there is no such option of methods"))?;
        self.give(option.parse(text)?);
        Ok(())
    }

    /// Asks for the parts of a method, such as `kd+ropes` ([`parse_method`]).
    ///
    /// # Errors
    /// [`Error::Option`] when there is no such method.
    pub fn set_method(&mut self, text: &str) -> Result<()> {
        parse_method(text)?.into_iter().for_each(|choice| self.give(choice));
        Ok(())
    }

    /// The same, with or without counted work.
    #[must_use]
    pub fn with_counters(self, counters: bool) -> Request {
        Request { counters, ..self }
    }

    /// Everything that is asked for.
    pub fn given(&self) -> &[Choice] {
        &self.given
    }

    /// Whether a value of this option is asked for.
    pub fn has(&self, option: &str) -> bool {
        self.given.iter().any(|choice| choice.option().name == option)
    }

    /// The number of the name that was asked for of an option.
    fn name(&self, option: &str) -> Option<usize> {
        let choice = self.given.iter().find(|choice| choice.option().name == option)?;
        if let Value::Name(index) = choice.value() { Some(index) } else { None }
    }

    /// The structure that is asked for.
    pub fn structure(&self) -> Option<StructureKind> {
        self.name(StructureKind::OPTION).map(|index| StructureKind::ALL[index])
    }

    /// The packets that are asked for.
    pub fn packet_size(&self) -> Option<PacketSize> {
        self.name(PacketSize::OPTION).map(|index| PacketSize::ALL[index])
    }

    /// The triangle test that is asked for.
    pub fn intersector(&self) -> Option<Intersector> {
        self.name(Intersector::OPTION).map(|index| Intersector::ALL[index])
    }

    fn is_structure(choice: &Choice) -> bool {
        choice.option().name == StructureKind::OPTION
    }

    /// Everything that is asked for, in a structure that reads it; whether it goes together is not checked.
    fn in_structure(&self, kind: StructureKind) -> Result<TraceOptions> {
        let mut options = TraceOptions { counters: self.counters, ..TraceOptions::of(kind) };
        self.given
            .iter()
            .filter(|choice| !Self::is_structure(choice))
            .try_for_each(|choice| choice.set(&mut options))?;
        // A packet means nothing to most structures, and is no field of theirs.
        options.check_that_all_apply().map(|()| options)
    }

    fn valid_in(&self, kind: StructureKind) -> Result<TraceOptions> {
        let options = self.in_structure(kind)?;
        options.validate().map(|()| options)
    }

    /// The options with the structure, or, where that is left open, `preferred` or what else reads all that is set.
    ///
    /// # Errors
    /// [`Error::Option`] as [`TraceOptions::validate`].
    pub fn with_structure(&self, preferred: StructureKind) -> Result<TraceOptions> {
        self.valid_in(self.structure().unwrap_or_else(|| self.structure_for(preferred)))
    }

    /// `preferred`, or, if that does not read everything that is set here, the first structure that does: a grid's size
    /// is for grids, a build for kd-trees. `preferred` as well if there is none.
    fn structure_for(&self, preferred: StructureKind) -> StructureKind {
        let candidates = || [preferred, StructureKind::Kd].into_iter().chain(StructureKind::ALL.iter().copied());
        // A number beyond all limits is for the check of the options to name.
        let valid = candidates().find(|&kind| self.valid_in(kind).is_ok());
        valid.or_else(|| candidates().find(|&kind| self.in_structure(kind).is_ok())).unwrap_or(preferred)
    }

    /// Which limit keeps [`Request::structure_for`] from `preferred`, where that reads everything that is set here;
    /// `None` where nothing does, and where other structures are what the options are for.
    fn limit_against(&self, preferred: StructureKind) -> Option<String> {
        match self.in_structure(preferred).ok()?.validate() {
            Err(Error::Option { option, message }) => Some(format!("`{option}` {message}")),
            _ => None,
        }
    }

    /// Why `fastest` is not taken: a limit, or options that mean nothing to it.
    fn why_not(&self, fastest: StructureKind, limit: &Option<String>) -> String {
        if let Some(limit) = limit {
            return format!("{fastest} would be faster, but {limit}");
        }
        let is_foreign = |choice: &&Choice| !choice.option().structures.contains(&fastest) && !choice.is_default();
        let names: Vec<_> = self.given.iter().filter(is_foreign).map(|c| format!("`{}`", c.option().name)).collect();
        format!("{} means nothing to {fastest}, which would be faster", names.join(", "))
    }

    /// Chooses what is left open for `workload`: as `tuned`, what measuring found to be fastest on the device for
    /// scenes of this size, has it where that goes together with what is set, else by the model.
    ///
    /// # Errors
    /// [`Error::Option`] as [`TraceOptions::validate`].
    pub fn choose(&self, workload: &Workload, tuned: Option<&TunedChoice>) -> Result<Chosen> {
        // What else is set may mean nothing to the structure that leaves instances shared.
        let shares =
            workload.is_worth_sharing() && self.structure_for(StructureKind::Instances) == StructureKind::Instances;
        let shared_triangles = if shares { workload.shared_triangles } else { 0 };
        let workload = &Workload { shared_triangles, ..*workload };
        let tuned = tuned
            .filter(|_| !workload.points)
            .filter(|tuned| self.accepts(tuned) && (self.structure().is_some() || !shares));
        let mut limit = None;
        let structure = match (self.structure(), tuned) {
            (Some(kind), _) => given(kind),
            (None, Some(tuned)) => (tuned.structure, Source::Tuned, tuned.reason.clone()),
            (None, None) => {
                let (fastest, why) = workload.structure();
                let kind = self.structure_for(fastest);
                limit = self.limit_against(fastest).filter(|_| kind != fastest);
                by_model((kind, if kind == fastest { why } else { self.why_not(fastest, &limit) }))
            }
        };
        let options = self.valid_in(structure.0)?;
        let packets = match (self.packet_size(), tuned) {
            (Some(size), _) => given(size),
            (None, Some(tuned)) => (tuned.packet_size, Source::Tuned, tuned.reason.clone()),
            _ => by_model(workload.packet_size(&options)),
        };
        let options = TraceOptions { packet_size: packets.0, ..options };
        let intersector = match self.intersector() {
            Some(intersector) => given(intersector),
            None => (options.intersector, Source::Model, "the default: hits as exact arithmetic has them".to_owned()),
        };
        let mut decisions = vec![
            decision(StructureKind::OPTION, structure),
            decision(PacketSize::OPTION, packets),
            decision(Intersector::OPTION, intersector),
        ];
        decisions.extend(workload.triangle_count.into_iter().flat_map(|count| numbers_in_effect(&options, count)));
        // The reference has no kernels.
        decisions.extend(workload.features.filter(|_| workload.device.is_some()).map(|features| {
            let features = match options.picture.features {
                KernelFeatures::Scene => by_model(kernel_features(features, options.arrays.layout)),
                all => given(all),
            };
            decision(KernelFeatures::OPTION, features)
        }));
        decisions.extend(workload.features.and(workload.device).map(|device| {
            let asked = options.picture.decisions;
            let (who, reason) = who_decides(asked, device);
            decision(Decisions::OPTION, if asked == Decisions::Auto { by_model((who, reason)) } else { given(who) })
        }));
        decisions.extend(workload.device.map(|device| {
            let (size, reason) = work_group_size(device);
            decision("work-group size", (size, Source::Model, reason))
        }));
        Ok(Chosen { options, decisions, limit })
    }

    /// Whether what was measured is of use here: it was measured with exact hits and with nothing else set.
    fn accepts(&self, tuned: &TunedChoice) -> bool {
        let options = self.in_structure(tuned.structure);
        let with_packets = |options| TraceOptions { packet_size: tuned.packet_size, ..options };
        self.intersector().is_none_or(|intersector| intersector == Intersector::Exact)
            && self.structure().is_none_or(|kind| kind == tuned.structure)
            && self.packet_size().is_none_or(|size| size == tuned.packet_size)
            && options.is_ok_and(|options| with_packets(options).validate().is_ok())
    }
}

/// The numbers of the build of a structure of `triangle_count` triangles, and why they are what they are.
pub fn numbers_in_effect(options: &TraceOptions, triangle_count: usize) -> Vec<Decision> {
    let build = BuildOptions::of(options, triangle_count);
    let is_default_cost = build.cost_intersect == KdOptions::COST;
    let rows = [
        ("leaf_size", build.leaf_size.to_string(), why_leaf_size(options, triangle_count)),
        (
            "max_depth",
            build.max_depth.to_string(),
            format!("a little deeper than a balanced tree of {triangle_count} triangles"),
        ),
        (
            "cost_traverse",
            build.cost_traverse.to_string(),
            if build.cost_traverse == KdOptions::COST {
                "the unit of costs"
            } else {
                "a step takes intervals of sixteen rays, and a frustum leaves most triangles out"
            }
            .to_owned(),
        ),
        (
            "cost_intersect",
            build.cost_intersect.to_string(),
            match (is_default_cost, build.cost_traverse == KdOptions::COST) {
                (true, true) => "a test takes about as long as a step",
                (true, false) => "the unit of costs",
                (false, _) => "eight triangles are tested at once",
            }
            .to_owned(),
        ),
        (
            "empty_bonus",
            build.empty_bonus.to_string(),
            "cutting off empty space pays more than the costs say".to_owned(),
        ),
        ("reinsert", build.reinsert.to_string(), "later passes move nothing any more".to_owned()),
        ("spatial_splits", build.spatial_splits.to_string(), "cut triangles pay in few scenes".to_owned()),
    ];
    rows.into_iter().filter_map(|(name, value, reason)| in_effect(options, name, value, reason)).collect()
}

/// The decision about a number; `None` where neither structure nor build reads it.
fn in_effect(options: &TraceOptions, name: &'static str, value: String, reason: String) -> Option<Decision> {
    let option = MethodOption::find(name).expect("a row of the table of options");
    // The costs mean nothing to builds that do not weigh them.
    let is_read = option.choices().all(|choice| {
        let mut options = *options;
        choice.set(&mut options).is_ok() && options.validate().is_ok()
    });
    let value = if option.is_set(options) { given(value) } else { (value, Source::Model, reason) };
    is_read.then(|| decision(name, value))
}

fn why_leaf_size(options: &TraceOptions, triangle_count: usize) -> String {
    match options.structure {
        Structure::Kd(kd) if kd.stop() == Stop::Cost => "the costs decide what becomes a leaf".to_owned(),
        Structure::Kd(kd) => format!("the least expected cost of a tree by {} that stops by size", kd.build),
        Structure::Boxes(_) | Structure::Spheres(_) => {
            format!("the square root of {triangle_count} triangles: as many tests as clusters")
        }
        Structure::Octree(_) => "fewer triangles are not worth a division".to_owned(),
        _ => "the costs make most leaves smaller".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device_info::{DeviceInfo, DeviceKind, sample_info};
    use crate::options::BvhOptions;

    fn on(device: Option<&DeviceInfo>) -> Workload<'_> {
        Workload { triangle_count: Some(1000), ..Workload::without_scene(device) }
    }

    fn cpu() -> DeviceInfo {
        DeviceInfo { kind: DeviceKind::Cpu, ..sample_info() }
    }

    /// A request in words: `structure=kd leaf_size=9`.
    fn asked(text: &str) -> Request {
        let mut request = Request::default();
        for (name, value) in text.split_whitespace().map(|word| word.split_once('=').unwrap()) {
            request.set(name, value).unwrap();
        }
        request
    }

    /// The decision about `option`.
    fn about<'a>(chosen: &'a Chosen, option: &str) -> &'a Decision {
        chosen.decisions.iter().find(|decision| decision.option == option).expect("a decision")
    }

    #[test]
    fn what_is_set_decides_before_what_is_fast() {
        use StructureKind::{Bvh8, Grid, Kd};
        for (request, expected) in [
            ("", Bvh8),
            ("memory=constant", Bvh8),
            ("leaf_size=8", Bvh8),
            ("leaf_size=9", Kd),
            ("build=median", Kd),
            ("build=sah", Bvh8),
            ("traversal=ropes", Kd),
            ("max_depth=9", Kd),
            ("max_depth=99", Kd),
            ("grid_size=3,3,3", Grid),
            // Nothing reads both: the check of the options says so.
            ("grid_size=3,3,3 build=median", Bvh8),
        ] {
            assert_eq!(asked(request).structure_for(Bvh8), expected, "{request}");
        }
        let cpu = cpu();
        let chosen = |request: &str| asked(request).choose(&on(Some(&cpu)), None);
        let limited = chosen("leaf_size=9").unwrap();
        let limit = limited.limit.as_ref().unwrap();
        assert!(limit.starts_with("`leaf_size` 9: a leaf of `structure = bvh8`"), "{limited:?}");
        assert!(about(&limited, "structure").reason.contains(limit));
        let median = chosen("leaf_size=9 build=median").unwrap();
        assert_eq!((median.options.kind(), &median.limit), (Kd, &None));
        assert!(about(&median, "structure").reason.starts_with("`build` means nothing to bvh8"), "{median:?}");
        assert_eq!(chosen("").unwrap().limit, None);
        assert!(chosen("max_depth=99").is_err());
        let message = chosen("structure=grid traversal=ropes").unwrap_err().to_string();
        assert!(message.contains("traversal: means nothing to `structure = grid`"), "{message}");
    }

    #[test]
    fn packets_are_for_what_goes_together_with_them() {
        let cpu = cpu();
        for (request, counters, expected) in [
            ("structure=bvh8", false, PacketSize::Sixteen),
            ("structure=kd", false, PacketSize::Sixteen),
            ("structure=bvh2", false, PacketSize::One),
            ("structure=kd traversal=restart", false, PacketSize::One),
            ("structure=bvh8", true, PacketSize::One),
            ("structure=bvh8 intersector=watertight", false, PacketSize::Sixteen),
            ("structure=bvh8 intersector=precomputed", false, PacketSize::One),
            ("structure=kd intersector=moller-trumbore", false, PacketSize::Sixteen),
            ("structure=bvh8 packet_size=1", false, PacketSize::One),
        ] {
            let chosen = asked(request).with_counters(counters).choose(&on(Some(&cpu)), None).unwrap();
            assert_eq!(chosen.options.packet_size, expected, "{request}");
            if counters {
                assert!(about(&chosen, "packet_size").reason.contains("counters"), "{chosen:?}");
            }
        }
    }

    #[test]
    fn what_was_measured_comes_after_what_is_set_and_before_the_model() {
        use StructureKind::{Bvh2, Bvh8, Kd};
        let cpu = cpu();
        let tuned = TunedChoice { structure: Kd, packet_size: PacketSize::One, reason: "twice as fast".to_owned() };
        let with = |request: &str| {
            let chosen = asked(request).choose(&on(Some(&cpu)), Some(&tuned)).unwrap();
            (chosen.options.kind(), about(&chosen, "structure").source, about(&chosen, "packet_size").source)
        };
        let (given, by_tuning, model) = (Source::Given, Source::Tuned, Source::Model);
        assert_eq!(with(""), (Kd, by_tuning, by_tuning));
        assert_eq!(with("structure=bvh2"), (Bvh2, given, model));
        assert_eq!(with("structure=kd"), (Kd, given, by_tuning));
        assert_eq!(with("reinsert=1"), (Bvh8, model, model));
        assert_eq!(with("intersector=plucker"), (Bvh8, model, model));
        assert_eq!(with("packet_size=16"), (Bvh8, model, given));
        let chosen = Request::default().choose(&on(Some(&cpu)), Some(&tuned)).unwrap();
        assert_eq!(about(&chosen, "structure").to_string(), "structure kd: tuned for this device: twice as fast");
    }

    #[test]
    fn shared_instances_are_flattened_where_what_is_set_asks_for_it() {
        use StructureKind::{Bvh8, Instances, Kd};
        let cpu = cpu();
        let workload = Workload { shared_triangles: 1 << 24, ..on(Some(&cpu)) };
        let tuned = TunedChoice { structure: Kd, packet_size: PacketSize::One, reason: "twice as fast".into() };
        for (request, tuned, expected) in [
            ("", None, Instances),
            ("", Some(&tuned), Instances),
            ("packet_size=16", None, Bvh8),
            ("triangles=leaf-order", None, Bvh8),
            ("triangles=leaf-order", Some(&tuned), Kd),
            ("structure=kd", Some(&tuned), Kd),
        ] {
            let chosen = asked(request).choose(&workload, tuned).unwrap();
            assert_eq!(chosen.options.kind(), expected, "{request}");
            assert_eq!(about(&chosen, "packet_size").source == Source::Tuned, expected == Kd, "{request}");
        }
    }

    /// Every number that a structure reads has a line with the value that its build takes.
    #[test]
    fn numbers_of_the_build_are_those_in_effect() {
        for &kind in StructureKind::ALL {
            let options = TraceOptions::of(kind);
            let build = BuildOptions::of(&options, 1000);
            let decisions = numbers_in_effect(&options, 1000);
            let names: Vec<_> = decisions.iter().map(|decision| decision.option.as_ref()).collect();
            let expected: &[&str] = match options.structure {
                Structure::Kd(_) => &["leaf_size", "max_depth", "cost_traverse", "cost_intersect", "empty_bonus"],
                Structure::Bvh2(_) | Structure::Bvh8(_) | Structure::Instances(_) => {
                    &["leaf_size", "cost_traverse", "cost_intersect", "reinsert", "spatial_splits"]
                }
                Structure::Octree(_) => &["leaf_size", "max_depth"],
                Structure::Boxes(_) | Structure::Spheres(_) => &["leaf_size"],
                Structure::Brute | Structure::Grid(_) => &[],
            };
            assert_eq!(names, expected, "{kind}");
            if let Some(leaf) = decisions.first() {
                assert_eq!((&leaf.value, leaf.source), (&build.leaf_size.to_string(), Source::Model), "{kind}");
            }
        }
        let three = BvhOptions { leaf_size: Some(3), ..BvhOptions::DEFAULT };
        let options = TraceOptions { structure: Structure::Bvh2(three), ..TraceOptions::DEFAULT };
        assert_eq!(numbers_in_effect(&options, 10)[0].to_string(), "leaf_size 3: given");
    }

    /// What is asked for in one way is what is asked for in the other.
    #[test]
    fn options_become_requests() {
        let request = asked("structure=kd traversal=ropes leaf_size=3 memory=constant").with_counters(true);
        let options = request.with_structure(StructureKind::Bvh2).unwrap();
        assert_eq!(Request::of(&options).with_structure(StructureKind::Bvh2).unwrap(), options);
        let mut by_method = Request::default();
        by_method.set_method("ropes+kd").unwrap();
        assert_eq!(by_method, asked("structure=kd traversal=ropes"));
    }
}
