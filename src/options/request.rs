//! What is chosen where the user leaves the choice, and why: what was given, else what measuring on the device found
//! ([`crate::tune`]), else what the model of `automatic.rs` takes.
//!
//! Closest hits, and pixels, are the same whatever is chosen here, to the bit: only their time depends on it.

use super::automatic::{Workload, kernel_features, who_decides, work_group_size};
use super::{Accel, Decisions, Intersector, KdOptions, KernelFeatures, OPTIONS, PacketSize, Stop, TraceOptions};
use crate::accel::BuildOptions;
use crate::error::{Error, Result};
use serde::Serialize;
use std::fmt;

/// Where a choice comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Origin {
    /// Whoever asks has set it.
    Given,
    /// It was the fastest when it was measured on this device ([`crate::tune`]).
    Tuned,
    /// The model, or the default of a build.
    Model,
}

/// What measuring found to be the fastest for a device and scenes of one size; see [`crate::tune`].
#[derive(Debug, Clone, PartialEq)]
pub struct TunedChoice {
    /// The structure.
    pub accel: Accel,
    /// How many rays are traced together in it.
    pub packet_size: PacketSize,
    /// How much faster it was than what the model takes, and on what; for people.
    pub reason: String,
}

/// One choice: what, and why.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Decision {
    /// The option as the user types it, or words for what no option sets.
    pub option: &'static str,
    /// The value in effect.
    pub value: String,
    /// Where it comes from.
    pub origin: Origin,
    /// Why, for people; empty where it was given.
    pub reason: String,
}

/// As one line: `--accel bvh8: model: the device is a CPU, ...`.
impl fmt::Display for Decision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Decision { option, value, reason, .. } = self;
        match self.origin {
            Origin::Given => write!(f, "{option} {value}: given"),
            Origin::Tuned => write!(f, "{option} {value}: tuned for this device: {reason}"),
            Origin::Model => write!(f, "{option} {value}: model: {reason}"),
        }
    }
}

/// Options of which some are left to be chosen.
///
/// ```
/// use raybrook::options::{Accel, Origin, Request, Workload};
///
/// # fn main() -> raybrook::Result<()> {
/// let workload = Workload { device: None, triangle_count: Some(5000), features: None, shared_triangles: 0 };
/// let chosen = Request::default().choose(&workload, None)?;
/// assert_eq!(chosen.options.accel, Accel::Kd); // the reference is fastest so in scenes of this size
/// assert!(chosen.decisions.iter().all(|decision| decision.origin == Origin::Model));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, Default)]
pub struct Request {
    /// The structure; `None`: the fastest that reads what is set.
    pub accel: Option<Accel>,
    /// How many rays are traced together; `None`: as many as is fastest.
    pub packet_size: Option<PacketSize>,
    /// The triangle test; `None`: the default.
    pub intersector: Option<Intersector>,
    /// Everything else; its structure, packet size and triangle test are not read.
    pub rest: TraceOptions,
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

/// A value, where it comes from, and why.
type Sourced<T> = (T, Origin, String);

fn given<T>(value: T) -> Sourced<T> {
    (value, Origin::Given, String::new())
}

fn by_model<T>((value, reason): (T, String)) -> Sourced<T> {
    (value, Origin::Model, reason)
}

fn decision<T: fmt::Display>(option: &'static str, (value, origin, reason): Sourced<T>) -> Decision {
    Decision { option, value: value.to_string(), origin, reason }
}

impl Request {
    /// The options before structure and packets are chosen.
    fn base(&self) -> TraceOptions {
        TraceOptions {
            accel: TraceOptions::DEFAULT.accel,
            packet_size: self.packet_size.unwrap_or(TraceOptions::DEFAULT.packet_size),
            intersector: self.intersector.unwrap_or(TraceOptions::DEFAULT.intersector),
            ..self.rest
        }
    }

    /// The options with the structure, or, where that is left open, `preferred` or what else reads all that is set.
    ///
    /// # Errors
    /// [`Error::Option`] as [`TraceOptions::validate`].
    pub fn with_structure(&self, preferred: Accel) -> Result<TraceOptions> {
        let base = self.base();
        let options = TraceOptions { accel: self.accel.unwrap_or_else(|| base.structure_for(preferred)), ..base };
        options.validate().map(|()| options)
    }

    /// Chooses what is left open for `workload`: as `tuned`, what measuring found to be fastest on the device for scenes of this size,
    /// has it where that goes together with what is set, else by the model.
    ///
    /// # Errors
    /// [`Error::Option`] as [`TraceOptions::validate`].
    pub fn choose(&self, workload: &Workload, tuned: Option<&TunedChoice>) -> Result<Chosen> {
        let base = self.base();
        // What else is set may mean nothing to the structure that leaves instances shared.
        let shares = workload.is_worth_sharing() && base.structure_for(Accel::Instances) == Accel::Instances;
        let shared_triangles = if shares { workload.shared_triangles } else { 0 };
        let workload = &Workload { shared_triangles, ..*workload };
        let tuned = tuned.filter(|tuned| self.accepts(tuned) && (self.accel.is_some() || !shares));
        let mut limit = None;
        let structure = match (self.accel, tuned) {
            (Some(accel), _) => given(accel),
            (None, Some(tuned)) => (tuned.accel, Origin::Tuned, tuned.reason.clone()),
            (None, None) => {
                let (fastest, why) = workload.structure();
                let accel = base.structure_for(fastest);
                limit = base.limit_against(fastest).filter(|_| accel != fastest);
                by_model((accel, if accel == fastest { why } else { base.why_not(fastest, &limit) }))
            }
        };
        let options = TraceOptions { accel: structure.0, ..base };
        options.validate()?;
        let packets = match (self.packet_size, tuned) {
            (Some(size), _) => given(size),
            (None, Some(tuned)) => (tuned.packet_size, Origin::Tuned, tuned.reason.clone()),
            _ => by_model(workload.packet_size(&options)),
        };
        let options = TraceOptions { packet_size: packets.0, ..options };
        let intersector = match self.intersector {
            Some(intersector) => given(intersector),
            None => (options.intersector, Origin::Model, "the default: hits as exact arithmetic has them".to_owned()),
        };
        let mut decisions = vec![
            decision(Accel::OPTION, structure),
            decision(PacketSize::OPTION, packets),
            decision(Intersector::OPTION, intersector),
        ];
        decisions.extend(workload.triangle_count.into_iter().flat_map(|count| options.numbers_in_effect(count)));
        // The reference has no kernels.
        decisions.extend(workload.features.filter(|_| workload.device.is_some()).map(|features| {
            let features = match options.features {
                KernelFeatures::Scene => by_model(kernel_features(features, options.layout)),
                all => given(all),
            };
            decision(KernelFeatures::OPTION, features)
        }));
        decisions.extend(workload.features.and(workload.device).map(|device| {
            let (who, reason) = who_decides(options.decisions, device);
            decision(
                Decisions::OPTION,
                if options.decisions == Decisions::Auto { by_model((who, reason)) } else { given(who) },
            )
        }));
        decisions.extend(workload.device.map(|device| {
            let (size, reason) = work_group_size(device);
            decision("work-group size", (size, Origin::Model, reason))
        }));
        Ok(Chosen { options, decisions, limit })
    }

    /// Whether what was measured is of use here: it was measured with exact hits and with nothing else set.
    fn accepts(&self, tuned: &TunedChoice) -> bool {
        let base = self.base();
        let options = TraceOptions { accel: tuned.accel, packet_size: tuned.packet_size, ..base };
        base.intersector == Intersector::Exact
            && self.accel.is_none_or(|accel| accel == tuned.accel)
            && self.packet_size.is_none_or(|size| size == tuned.packet_size)
            && options.validate().is_ok()
    }
}

impl TraceOptions {
    /// `preferred`, or, if that does not read everything that is set here, the first structure that does: a grid's size is for grids, a
    /// build for kd-trees. `preferred` as well if there is none.
    fn structure_for(&self, preferred: Accel) -> Accel {
        let candidates = || std::iter::once(preferred).chain([Accel::Kd]).chain(Accel::ALL.iter().copied());
        let reads_all =
            |accel: &Accel| OPTIONS.iter().all(|option| !option.is_set(self) || option.structures.contains(accel));
        let fits = |accel: &Accel| reads_all(accel) && TraceOptions { accel: *accel, ..*self }.validate().is_ok();
        // A number beyond all limits is for the check of the options to name.
        candidates().find(fits).or_else(|| candidates().find(reads_all)).unwrap_or(preferred)
    }

    /// Which limit keeps [`TraceOptions::structure_for`] from `preferred`, where that reads everything that is set here; `None` where
    /// nothing does, and where other structures are what the options are for.
    fn limit_against(&self, preferred: Accel) -> Option<String> {
        let options = TraceOptions { accel: preferred, ..*self };
        match options.check_that_all_apply().and_then(|()| options.validate()) {
            Err(Error::Option { option, message }) if options.check_that_all_apply().is_ok() => {
                Some(format!("{option} {message}"))
            }
            _ => None,
        }
    }

    /// Why `fastest` is not taken: a limit, or options that mean nothing to it.
    fn why_not(&self, fastest: Accel, limit: &Option<String>) -> String {
        if let Some(limit) = limit {
            return format!("{fastest} would be faster, but {limit}");
        }
        let foreign = OPTIONS.iter().filter(|option| option.is_set(self) && !option.structures.contains(&fastest));
        let names: Vec<_> = foreign.map(|option| option.name).collect();
        format!("{} means nothing to {fastest}, which would be faster", names.join(", "))
    }

    /// The numbers of the build of a structure of `triangle_count` triangles, and why they are what they are.
    pub fn numbers_in_effect(&self, triangle_count: usize) -> Vec<Decision> {
        let build = BuildOptions::of(self, triangle_count);
        let kd = self.kd;
        let is_default_cost = build.cost_intersect == KdOptions::COST;
        let rows = [
            ("--leaf-size", self.leaf_size.is_some(), build.leaf_size.to_string(), self.why_leaf_size(triangle_count)),
            (
                "--max-depth",
                self.max_depth.is_some(),
                build.max_depth.to_string(),
                format!("a little deeper than a balanced tree of {triangle_count} triangles"),
            ),
            (
                "--cost-traverse",
                kd.cost_traverse.is_some(),
                build.cost_traverse.to_string(),
                if build.cost_traverse == KdOptions::COST {
                    "the unit of costs"
                } else {
                    "a step takes intervals of sixteen rays, and a frustum leaves most triangles out"
                }
                .to_owned(),
            ),
            (
                "--cost-intersect",
                kd.cost_intersect.is_some(),
                build.cost_intersect.to_string(),
                match (is_default_cost, build.cost_traverse == KdOptions::COST) {
                    (true, true) => "a test takes about as long as a step",
                    (true, false) => "the unit of costs",
                    (false, _) => "eight triangles are tested at once",
                }
                .to_owned(),
            ),
            (
                "--empty-bonus",
                kd.empty_bonus.is_some(),
                build.empty_bonus.to_string(),
                "cutting off empty space pays more than the costs say".to_owned(),
            ),
            (
                "--reinsert",
                self.reinsert.is_some(),
                build.reinsert.to_string(),
                "later passes move nothing any more".to_owned(),
            ),
            (
                "--spatial-splits",
                self.spatial_splits.is_some(),
                build.spatial_splits.to_string(),
                "cut triangles pay in few scenes".to_owned(),
            ),
        ];
        let is_read = |name: &str| {
            let option = OPTIONS.iter().find(|option| option.name == name).expect("a row of the table of options");
            // The costs mean nothing to builds that do not weigh them.
            option.structures.contains(&self.accel)
                && option.choices().all(|choice| {
                    let mut options = *self;
                    choice.set(&mut options);
                    options.validate().is_ok()
                })
        };
        let decide = |(option, is_given, value, reason): (&'static str, bool, String, String)| {
            decision(option, if is_given { given(value) } else { (value, Origin::Model, reason) })
        };
        rows.into_iter().filter(|(option, ..)| is_read(option)).map(decide).collect()
    }

    fn why_leaf_size(&self, triangle_count: usize) -> String {
        match self.accel {
            Accel::Kd if self.kd.stop(self.build) == Stop::Cost => "the costs decide what becomes a leaf".to_owned(),
            Accel::Kd => format!("the least expected cost of a tree by {} that stops by size", self.build),
            Accel::Boxes | Accel::Spheres => {
                format!("the square root of {triangle_count} triangles: as many tests as clusters")
            }
            Accel::Octree => "fewer triangles are not worth a division".to_owned(),
            _ => "the costs make most leaves smaller".to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device_info::{DeviceInfo, DeviceKind, sample_info};
    use crate::options::{Build, Memory, Traversal, TriangleOrder};

    const DEFAULT: TraceOptions = TraceOptions::DEFAULT;

    fn on(device: Option<&DeviceInfo>) -> Workload<'_> {
        Workload { device, triangle_count: Some(1000), features: None, shared_triangles: 0 }
    }

    fn cpu() -> DeviceInfo {
        DeviceInfo { kind: DeviceKind::Cpu, ..sample_info() }
    }

    fn rest(rest: TraceOptions) -> Request {
        Request { rest, ..Request::default() }
    }

    /// The decision about `option`.
    fn about<'a>(chosen: &'a Chosen, option: &str) -> &'a Decision {
        chosen.decisions.iter().find(|decision| decision.option == option).expect("a decision")
    }

    #[test]
    fn what_is_set_decides_before_what_is_fast() {
        for (options, expected) in [
            (DEFAULT, Accel::Bvh8),
            (TraceOptions { memory: Memory::Constant, ..DEFAULT }, Accel::Bvh8),
            (TraceOptions { leaf_size: Some(8), ..DEFAULT }, Accel::Bvh8),
            (TraceOptions { leaf_size: Some(9), ..DEFAULT }, Accel::Kd),
            (TraceOptions { build: Build::Median, ..DEFAULT }, Accel::Kd),
            (TraceOptions { traversal: Traversal::Ropes, ..DEFAULT }, Accel::Kd),
            (TraceOptions { max_depth: Some(9), ..DEFAULT }, Accel::Kd),
            (TraceOptions { max_depth: Some(99), ..DEFAULT }, Accel::Kd),
            (TraceOptions { grid_size: Some([3; 3]), ..DEFAULT }, Accel::Grid),
            // Nothing reads both: the check of the options says so.
            (TraceOptions { grid_size: Some([3; 3]), build: Build::Median, ..DEFAULT }, Accel::Bvh8),
        ] {
            assert_eq!(options.structure_for(Accel::Bvh8), expected, "{options:?}");
        }
        let cpu = cpu();
        let chosen = |options| rest(options).choose(&on(Some(&cpu)), None).unwrap();
        let large = TraceOptions { leaf_size: Some(9), ..DEFAULT };
        let limited = chosen(large);
        assert!(limited.limit.as_ref().unwrap().starts_with("--leaf-size 9: a leaf of --accel bvh8"), "{limited:?}");
        assert!(about(&limited, "--accel").reason.contains(limited.limit.as_ref().unwrap()));
        let median = chosen(TraceOptions { build: Build::Median, ..large });
        assert_eq!((median.options.accel, &median.limit), (Accel::Kd, &None));
        assert!(about(&median, "--accel").reason.starts_with("--build means nothing to bvh8"), "{median:?}");
        assert_eq!(chosen(DEFAULT).limit, None);
        assert!(rest(TraceOptions { max_depth: Some(99), ..DEFAULT }).choose(&on(None), None).is_err());
    }

    #[test]
    fn packets_are_for_what_goes_together_with_them() {
        let cpu = cpu();
        let with = |request: Request| request.choose(&on(Some(&cpu)), None).unwrap();
        let bvh8 = Request { accel: Some(Accel::Bvh8), ..Request::default() };
        let counters = TraceOptions { counters: true, ..DEFAULT };
        let restart = TraceOptions { traversal: Traversal::Restart, ..DEFAULT };
        for (request, expected) in [
            (bvh8, PacketSize::Sixteen),
            (Request { accel: Some(Accel::Kd), ..bvh8 }, PacketSize::Sixteen),
            (Request { accel: Some(Accel::Bvh2), ..bvh8 }, PacketSize::One),
            (Request { accel: Some(Accel::Kd), rest: restart, ..bvh8 }, PacketSize::One),
            (Request { rest: counters, ..bvh8 }, PacketSize::One),
            (Request { intersector: Some(Intersector::Watertight), ..bvh8 }, PacketSize::One),
            (Request { packet_size: Some(PacketSize::One), ..bvh8 }, PacketSize::One),
        ] {
            assert_eq!(with(request).options.packet_size, expected, "{request:?}");
        }
        let why = with(Request { rest: counters, ..bvh8 });
        assert!(about(&why, "--packet-size").reason.contains("--counters"), "{why:?}");
    }

    #[test]
    fn what_was_measured_comes_after_what_is_set_and_before_the_model() {
        let cpu = cpu();
        let tuned = TunedChoice { accel: Accel::Kd, packet_size: PacketSize::One, reason: "twice as fast".to_owned() };
        let with = |request: Request| {
            let chosen = request.choose(&on(Some(&cpu)), Some(&tuned)).unwrap();
            (chosen.options.accel, about(&chosen, "--accel").origin, about(&chosen, "--packet-size").origin)
        };
        let default = Request::default();
        let (given, tuned_origin, model) = (Origin::Given, Origin::Tuned, Origin::Model);
        assert_eq!(with(default), (Accel::Kd, tuned_origin, tuned_origin));
        assert_eq!(with(Request { accel: Some(Accel::Bvh2), ..default }), (Accel::Bvh2, given, model));
        assert_eq!(with(Request { accel: Some(Accel::Kd), ..default }), (Accel::Kd, given, tuned_origin));
        assert_eq!(with(rest(TraceOptions { reinsert: Some(1), ..DEFAULT })), (Accel::Bvh8, model, model));
        let rounded = Request { intersector: Some(Intersector::Plucker), ..default };
        assert_eq!(with(rounded), (Accel::Bvh8, model, model));
        let sixteen = Request { packet_size: Some(PacketSize::Sixteen), ..default };
        assert_eq!(with(sixteen), (Accel::Bvh8, model, given));
        let chosen = default.choose(&on(Some(&cpu)), Some(&tuned)).unwrap();
        assert_eq!(about(&chosen, "--accel").to_string(), "--accel kd: tuned for this device: twice as fast");
    }

    #[test]
    fn shared_instances_are_flattened_where_what_is_set_asks_for_it() {
        let cpu = cpu();
        let workload = Workload { shared_triangles: 1 << 24, ..on(Some(&cpu)) };
        let tuned = TunedChoice { accel: Accel::Kd, packet_size: PacketSize::One, reason: "twice as fast".into() };
        let sixteen = Request { packet_size: Some(PacketSize::Sixteen), ..Request::default() };
        let leaf_order = rest(TraceOptions { triangles: TriangleOrder::LeafOrder, ..DEFAULT });
        let kd = Request { accel: Some(Accel::Kd), ..Request::default() };
        for (request, tuned, expected) in [
            (Request::default(), None, Accel::Instances),
            (Request::default(), Some(&tuned), Accel::Instances),
            (sixteen, None, Accel::Bvh8),
            (leaf_order, None, Accel::Bvh8),
            (leaf_order, Some(&tuned), Accel::Kd),
            (kd, Some(&tuned), Accel::Kd),
        ] {
            let chosen = request.choose(&workload, tuned).unwrap();
            assert_eq!(chosen.options.accel, expected, "{request:?}");
            let packets = chosen.decisions.iter().find(|decision| decision.option == PacketSize::OPTION).unwrap();
            assert_eq!(packets.origin == Origin::Tuned, expected == Accel::Kd, "{request:?}");
        }
    }

    /// Every number that a structure reads has a line with the value that its build takes.
    #[test]
    fn numbers_of_the_build_are_those_in_effect() {
        for &accel in Accel::ALL {
            let options = TraceOptions { accel, ..DEFAULT };
            let build = BuildOptions::of(&options, 1000);
            let decisions = options.numbers_in_effect(1000);
            let names: Vec<_> = decisions.iter().map(|decision| decision.option).collect();
            let expected: &[&str] = match accel {
                Accel::Kd => &["--leaf-size", "--max-depth", "--cost-traverse", "--cost-intersect", "--empty-bonus"],
                Accel::Bvh2 | Accel::Bvh8 | Accel::Instances => {
                    &["--leaf-size", "--cost-traverse", "--cost-intersect", "--reinsert", "--spatial-splits"]
                }
                Accel::Octree => &["--leaf-size", "--max-depth"],
                Accel::Boxes | Accel::Spheres => &["--leaf-size"],
                Accel::Brute | Accel::Grid => &[],
            };
            assert_eq!(names, expected, "{accel}");
            if let Some(leaf) = decisions.first() {
                assert_eq!((&leaf.value, leaf.origin), (&build.leaf_size.to_string(), Origin::Model), "{accel}");
            }
        }
        let given = TraceOptions { accel: Accel::Bvh2, leaf_size: Some(3), ..DEFAULT }.numbers_in_effect(10);
        assert_eq!(given[0].to_string(), "--leaf-size 3: given");
    }
}
