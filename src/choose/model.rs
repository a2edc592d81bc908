//! The model that chooses where the user leaves the choice and nothing was measured. Each of its functions returns the
//! choice together with the reason, so that no second list of reasons can go out of step; `request.rs` asks them.

use super::SceneSize;
use crate::device_info::{DeviceInfo, DeviceKind};
use crate::features::Features;
use crate::options::{Intersector, KernelFeatures, Layout, PacketSize, StructureKind, TraceOptions};
use crate::scene::Scene;
use crate::shared::Feature;
use crate::shared::Shading;

/// The work that methods are chosen for.
#[derive(Debug, Clone, Copy)]
pub struct Workload<'a> {
    /// Where it is done; `None`: on the reference.
    pub device: Option<&'a DeviceInfo>,
    /// Triangles that can be hit; `None` where there is no scene yet.
    pub triangle_count: Option<usize>,
    /// What pictures of the scene need of the kernels; `None` for batches of rays, and where there is no scene yet.
    pub features: Option<Features>,
    /// Triangles that need no place of their own, because instances share them.
    pub shared_triangles: usize,
    /// Whether closest points are asked for, and no rays.
    pub points: bool,
}

/// Triangles from which on it takes longer to make those of instances, and to build over them, than most pictures gain
/// by it. Two cores took 44 s for the 29,280,000 triangles of 7,381 instances instead of 3, and PoCL then traced rays
/// 2.2 times as fast in packets, one at a time at the same speed. Sixteen cores took 12 s instead of 0.9, and an H200
/// traced 1.3 times as fast; with 100 and 1,000 instances of 2,048 triangles 1.2 times and at the same speed, for
/// builds of ten times as long.
const WORTH_SHARING: usize = 1 << 20;
const WORTH_SHARING_ON_GPU: usize = 1 << 16;

impl<'a> Workload<'a> {
    /// Batches of rays through whatever scene, on `device` (`None`: the reference).
    pub fn without_scene(device: Option<&'a DeviceInfo>) -> Self {
        Workload { device, triangle_count: None, features: None, shared_triangles: 0, points: false }
    }

    /// Rays through `scene`, or pictures of it.
    pub fn of_scene(device: Option<&'a DeviceInfo>, scene: &Scene, pictures: bool) -> Self {
        Workload {
            device,
            triangle_count: Some(scene.hittable().len()),
            features: pictures.then(|| Features::of_scene(scene)),
            shared_triangles: scene.instances.triangle_count() - scene.instances.shared_triangle_count(),
            points: false,
        }
    }
}

impl Workload<'_> {
    fn kind(&self) -> Option<DeviceKind> {
        self.device.map(|device| device.kind)
    }

    /// Whether what instances share is worth a structure that leaves it shared.
    pub(super) fn is_worth_sharing(&self) -> bool {
        let least = if self.kind() == Some(DeviceKind::Gpu) { WORTH_SHARING_ON_GPU } else { WORTH_SHARING };
        self.shared_triangles >= least && !self.points
    }

    /// The fastest structure with the triangle test that is the default.
    ///
    /// A CPU has vectors that one ray fills with eight boxes, so that the bunny takes half to a third of the kd-tree's
    /// time with [`StructureKind::Bvh8`]. A GPU's work-item has one lane, and the fewer registers it takes the better:
    /// [`StructureKind::Bvh2`]. Measured in `docs/record/2026-11-21-pocl-boxes-and-kd-tree.md` and
    /// `docs/record/2026-11-22-h200-boxes-and-kd-tree.md`.
    ///
    /// There is no number of triangles up to which brute force is the fastest on a CPU: by `raybrook tune` on PoCL (2
    /// cores, loose triangles and cubes on a floor) it had 0.14 to 0.26 of the speed of `bvh8` in packets with 2
    /// triangles, 0.04 to 0.12 with 4 to 16, 0.01 to 0.03 with 24 to 98. Beside `bvh8` one ray at a time it was 0.8 to
    /// 1.1 times as fast with 2 triangles, half as fast and less from 8 on. On an H200 it had 0.37 of the speed of
    /// `bvh2` with 38 triangles.
    ///
    /// The reference is scalar code, to which a kd-tree's one plane is less work than two boxes: `kd` had 1.4 to 2
    /// times the speed of `bvh2` in scenes of 948 to 99,202 triangles, the same in chess.toml. With 2 to 98 triangles
    /// it was 0.8 to 2.5 times as fast by turns; with 990,002 it was 1.3 times as fast, but the second that its build
    /// takes longer is more than a picture wins back.
    pub(super) fn structure(&self) -> (StructureKind, String) {
        let with_count = |reason: &str| match self.triangle_count {
            Some(count) => format!("{reason} ({count} triangles)"),
            None => reason.to_owned(),
        };
        if self.points {
            return match self.kind() {
                Some(DeviceKind::Cpu) => {
                    (StructureKind::Bvh8, "closest points are found in it, eight boxes at a time".to_owned())
                }
                _ => (StructureKind::Bvh2, "closest points are found in it, and in no other".to_owned()),
            };
        }
        if self.is_worth_sharing() {
            let shared = self.shared_triangles;
            let reason = format!(
                "{shared} triangles are shared by instances; to make and to build them takes longer than it gains"
            );
            return (StructureKind::Instances, reason);
        }
        match (self.kind(), self.triangle_count.map(SceneSize::of)) {
            (Some(DeviceKind::Cpu), _) => {
                let reason = "the device is a CPU, whose vectors hold the eight boxes of a node; brute force is slower \
                              at any size";
                (StructureKind::Bvh8, with_count(reason))
            }
            (Some(kind), _) => {
                let reason = "a work-item has one lane, and two boxes take few registers";
                (StructureKind::Bvh2, with_count(&format!("the device is of kind {kind}: {reason}")))
            }
            (None, Some(SceneSize::Small | SceneSize::Medium)) => {
                let reason = "one plane is less work to the reference than boxes, which pays from";
                (StructureKind::Kd, with_count(&format!("{reason} {}", kd_sizes())))
            }
            (None, _) => (
                StructureKind::Bvh2,
                with_count(&format!("the reference builds it soonest, and a kd-tree pays from {}", kd_sizes())),
            ),
        }
    }

    /// The fastest size of packets that goes together with `options`.
    ///
    /// A CPU's vectors hold sixteen rays, and even rays of all directions are 1.5 to 2.9 times as fast that way; a GPU
    /// makes such vectors of its work-items by itself. Pictures with glass, which sends rays different ways, run at
    /// 0.95 (nothing but glass) to 1.4 times the speed.
    pub(super) fn packet_size(&self, options: &TraceOptions) -> (PacketSize, String) {
        let sixteen = TraceOptions { packet_size: PacketSize::Sixteen, ..*options };
        match (self.kind(), sixteen.validate()) {
            (None, _) => (PacketSize::One, "the reference traces one ray after the other".to_owned()),
            (Some(DeviceKind::Cpu), Err(error)) => {
                (PacketSize::One, format!("{} do not go together with the rest: {error}", PacketSize::Sixteen))
            }
            (Some(DeviceKind::Cpu), Ok(())) => {
                (PacketSize::Sixteen, "the device is a CPU, whose vectors hold sixteen rays".to_owned())
            }
            (Some(kind), _) => {
                (PacketSize::One, format!("the device is of kind {kind}: it makes vectors of single rays by itself"))
            }
        }
    }
}

impl Workload<'_> {
    /// That a triangle test makes rays slower here than the exact one, where it does: with it they do not go in
    /// packets.
    pub fn slower_than_exact(&self, options: &TraceOptions) -> Option<String> {
        let exact = TraceOptions { intersector: Intersector::Exact, packet_size: PacketSize::Sixteen, ..*options };
        let is_slower =
            self.kind() == Some(DeviceKind::Cpu) && !options.intersector.has_packets() && exact.validate().is_ok();
        is_slower.then(|| {
            format!(
                "`{} = {}` is slower than {} on a CPU: its rays do not go in packets of {}",
                Intersector::OPTION,
                options.intersector,
                Intersector::Exact,
                PacketSize::Sixteen
            )
        })
    }
}

impl TraceOptions {
    /// Whether [`RayOrder::Auto`](crate::options::RayOrder::Auto) sorts shuffled batches on a kind of device (`None`:
    /// the reference). Packets on a CPU take up to eleven times as long when their rays are no neighbours, single rays
    /// up to 1.7 times, most of which sorting would take. An H200 takes 1.3 to 2.7 times as long, 0.1 to 0.5 ns a ray,
    /// and sixteen cores beside it sort one in 20 to 30.
    pub fn gains_by_sorted_rays(&self, device: Option<DeviceKind>) -> bool {
        device == Some(DeviceKind::Cpu) && self.packet_size == PacketSize::Sixteen
    }
}

/// Normals, texture coordinates and material of a triangle.
const SHADING_BYTES: usize = size_of::<Shading>();

/// What the kernels that shade are made for, where they have just the `features` that the scene needs, and why.
pub(super) fn kernel_features(features: Features, layout: Layout) -> (KernelFeatures, String) {
    let has_all = features.need_shading_data() || layout == Layout::Whole;
    let stays = match (has_all, features.has(Feature::SeveralMaterials)) {
        (true, _) => String::new(),
        (false, true) => format!(", and of {SHADING_BYTES} bytes a triangle for shading all but its material's number"),
        (false, false) => format!(", and {SHADING_BYTES} bytes a triangle for shading"),
    };
    let reason = match Feature::ALL.len() - features.iter().count() {
        0 => "the scene needs every feature".to_owned(),
        left_out => format!("the scene needs {features}; the other {left_out} are left out of the kernels{stays}"),
    };
    (KernelFeatures::Scene, reason)
}

/// For how many triangles the reference is fastest with a kd-tree.
fn kd_sizes() -> String {
    format!("{} to {} triangles", SceneSize::Small.fewest(), SceneSize::Large.fewest() - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::choose::{Chosen, Decision, Request, Source, TunedChoice};
    use crate::device::{who_decides, work_group_size};
    use crate::device_info::sample_info;
    use crate::options::Decisions;

    fn device(kind: DeviceKind) -> DeviceInfo {
        DeviceInfo { kind, ..sample_info() }
    }

    /// The decision about `option`.
    fn about<'a>(chosen: &'a Chosen, option: &str) -> &'a Decision {
        chosen.decisions.iter().find(|decision| decision.option == option).expect("a decision")
    }

    /// The model for every kind of device and size; each reason names what decided.
    #[test]
    fn the_model_follows_device_and_size() {
        let [cpu, gpu] = [DeviceKind::Cpu, DeviceKind::Gpu].map(device);
        let (one, sixteen) = (PacketSize::One, PacketSize::Sixteen);
        for (device, triangles, accel, packets, words) in [
            (Some(&cpu), 2, StructureKind::Bvh8, sixteen, ["CPU", "sixteen rays"]),
            (Some(&cpu), 2_000_000, StructureKind::Bvh8, sixteen, ["2000000 triangles", "CPU"]),
            (Some(&gpu), 5000, StructureKind::Bvh2, one, ["kind gpu", "kind gpu"]),
            (None, 99, StructureKind::Bvh2, one, ["99 triangles", "the reference"]),
            (None, 100, StructureKind::Kd, one, ["100 triangles", "the reference"]),
            (None, 299_999, StructureKind::Kd, one, ["299999 triangles", "the reference"]),
            (None, 300_000, StructureKind::Bvh2, one, ["300000 triangles", "the reference"]),
        ] {
            let workload = Workload { triangle_count: Some(triangles), ..Workload::without_scene(device) };
            let chosen = Request::default().choose(&workload, None).unwrap();
            assert_eq!((chosen.options.kind(), chosen.options.packet_size), (accel, packets), "{workload:?}");
            for (option, value, word) in
                [("structure", accel.name(), words[0]), ("packet_size", packets.name(), words[1])]
            {
                let decision = about(&chosen, option);
                assert_eq!((decision.value.as_str(), decision.source), (value, Source::Model), "{decision}");
                assert!(decision.reason.contains(word), "{decision}");
                assert!(decision.to_string().starts_with(&format!("{option} {value}: model: ")), "{decision}");
            }
        }
    }

    #[test]
    fn tests_without_packets_are_slower_where_the_exact_one_goes_in_packets() {
        let [cpu, gpu] = [DeviceKind::Cpu, DeviceKind::Gpu].map(device);
        let single = TraceOptions { intersector: Intersector::Precomputed, ..TraceOptions::of(StructureKind::Bvh8) };
        for (device, options, is_slower) in [
            (Some(&cpu), single, true),
            (Some(&cpu), TraceOptions { intersector: Intersector::FASTEST, ..single }, false),
            (Some(&cpu), TraceOptions { intersector: Intersector::Exact, ..single }, false),
            (Some(&cpu), single.with_structure(StructureKind::Grid), false),
            (Some(&gpu), single, false),
            (None, single, false),
        ] {
            let workload = Workload::without_scene(device);
            let warning = workload.slower_than_exact(&options);
            assert_eq!(warning.is_some(), is_slower, "{options:?}");
            let words = ["`intersector = precomputed`", "exact", "packets of 16"];
            assert!(warning.is_none_or(|warning| words.iter().all(|word| warning.contains(word))));
        }
    }

    #[test]
    fn instances_stay_shared_where_making_their_triangles_takes_longer_than_it_gains() {
        let [cpu, gpu] = [DeviceKind::Cpu, DeviceKind::Gpu].map(device);
        for (info, least) in [(None, WORTH_SHARING), (Some(&cpu), WORTH_SHARING), (Some(&gpu), WORTH_SHARING_ON_GPU)] {
            for (shared_triangles, is_shared) in [(0, false), (least - 1, false), (least, true)] {
                let workload =
                    Workload { triangle_count: Some(2_000_000), shared_triangles, ..Workload::without_scene(info) };
                let chosen = Request::default().choose(&workload, None).unwrap();
                assert_eq!(chosen.options.kind() == StructureKind::Instances, is_shared, "{workload:?}");
                assert_eq!(about(&chosen, "structure").reason.contains("shared by instances"), is_shared);
            }
        }
    }

    #[test]
    fn closest_points_are_looked_for_where_they_are_found() {
        let (cpu, gpu) = (device(DeviceKind::Cpu), device(DeviceKind::Gpu));
        let devices =
            [(Some(&cpu), StructureKind::Bvh8), (Some(&gpu), StructureKind::Bvh2), (None, StructureKind::Bvh2)];
        for (info, expected) in devices {
            let workload = Workload { points: true, shared_triangles: WORTH_SHARING, ..Workload::without_scene(info) };
            let tuned =
                TunedChoice { structure: StructureKind::Grid, packet_size: PacketSize::One, reason: String::new() };
            let chosen = Request::default().choose(&workload, Some(&tuned)).unwrap();
            assert_eq!(chosen.options.kind(), expected);
            assert!(about(&chosen, "structure").reason.contains("closest points"));
            let mut asked = Request::default();
            asked.set(StructureKind::OPTION, "kd").unwrap();
            assert_eq!(asked.choose(&workload, None).unwrap().options.kind(), StructureKind::Kd);
        }
    }

    #[test]
    fn devices_decide_that_would_wait_and_decide_as_the_host_does() {
        let gpu = device(DeviceKind::Gpu);
        let coarse = DeviceInfo { correctly_rounded_divide_sqrt: false, ..gpu.clone() };
        for (asked, info, expected) in [
            (Decisions::Auto, &gpu, Decisions::Device),
            (Decisions::Auto, &coarse, Decisions::Host),
            (Decisions::Auto, &device(DeviceKind::Cpu), Decisions::Host),
            (Decisions::Host, &gpu, Decisions::Host),
            (Decisions::Device, &coarse, Decisions::Device),
        ] {
            assert_eq!(who_decides(asked, info).0, expected, "{asked} on {info:?}");
        }
        let of = |features| {
            let workload = Workload { features, ..Workload::without_scene(Some(&gpu)) };
            Request::default().choose(&workload, None).unwrap()
        };
        assert_eq!(about(&of(Some(Features::ALL)), "decisions").value, "device");
        assert!(of(None).decisions.iter().all(|decision| decision.option != "decisions"), "a batch has none");
    }

    #[test]
    fn work_groups_are_no_larger_than_the_device_has_them() {
        let gpu = device(DeviceKind::Gpu);
        assert_eq!(work_group_size(&gpu).0, 64);
        assert_eq!(work_group_size(&device(DeviceKind::Cpu)).0, 16);
        let (size, reason) = work_group_size(&DeviceInfo { max_work_group_size: 8, ..gpu.clone() });
        assert!(size == 8 && reason.contains("no larger"), "{reason}");
        let chosen = Request::default().choose(&Workload::without_scene(Some(&gpu)), None).unwrap();
        assert_eq!(about(&chosen, "work-group size").value, "64");
    }
}
