//! What is chosen where the user leaves the choice, by a small model of the device.

use super::{Accel, OPTIONS, PacketSize, TraceOptions};
use crate::device::DeviceKind;
use crate::error::Error;
use crate::scene::{Material, Scene};

impl Accel {
    /// The fastest structure on a kind of device (`None`: the reference), with the triangle test that is the default.
    ///
    /// A CPU has vectors that one ray fills with eight boxes, so that the bunny takes half to a third of the kd-tree's time with
    /// [`Accel::Bvh8`]. A GPU's work-item has one lane, and the fewer registers it takes the better: [`Accel::Bvh2`]. Measured in
    /// `docs/records.md`.
    pub fn fastest_on(device: Option<DeviceKind>) -> Accel {
        match device {
            Some(DeviceKind::Cpu) => Accel::Bvh8,
            _ => Accel::Bvh2,
        }
    }
}

impl PacketSize {
    /// Whether it is no slower than single rays for pictures of `scene`. Rays that glass sends different ways gain nothing by
    /// packets: a picture of glass alone took 1.15 times as long.
    pub fn suits_picture(self, scene: &Scene) -> bool {
        self == PacketSize::One || !scene.materials.iter().any(Material::is_transparent)
    }
}

impl TraceOptions {
    /// The fastest size of packets on a kind of device that goes together with these options. A CPU's vectors hold sixteen rays, and
    /// even rays of all directions are 1.5 to 2.9 times as fast that way; a GPU makes such vectors of its work-items by itself.
    pub fn fastest_packets_on(&self, device: Option<DeviceKind>) -> PacketSize {
        let sixteen = TraceOptions { packet_size: PacketSize::Sixteen, ..*self };
        if device == Some(DeviceKind::Cpu) && sixteen.validate().is_ok() {
            PacketSize::Sixteen
        } else {
            PacketSize::One
        }
    }

    /// Whether [`RayOrder::Auto`](super::RayOrder::Auto) sorts shuffled batches on a kind of device (`None`: the reference). Packets on
    /// a CPU take up to eleven times as long when their rays are no neighbours, single rays up to 1.7 times, most of which sorting would
    /// take. A GPU loses two thirds, but the H200 traces even shuffled rays in a nanosecond each, and two cores sort one in 30: not
    /// measured there.
    pub fn gains_by_sorted_rays(&self, device: Option<DeviceKind>) -> bool {
        device == Some(DeviceKind::Cpu) && self.packet_size == PacketSize::Sixteen
    }

    /// `preferred`, or, if that does not read everything that is set here, the first structure that does: a grid's size is for grids, a
    /// build for kd-trees. `preferred` as well if there is none.
    pub fn structure_for(&self, preferred: Accel) -> Accel {
        let candidates = || std::iter::once(preferred).chain([Accel::Kd]).chain(Accel::ALL.iter().copied());
        let reads_all =
            |accel: &Accel| OPTIONS.iter().all(|option| !option.is_set(self) || option.structures.contains(accel));
        let fits = |accel: &Accel| reads_all(accel) && TraceOptions { accel: *accel, ..*self }.validate().is_ok();
        // A number beyond all limits is for the check of the options to name.
        candidates().find(fits).or_else(|| candidates().find(reads_all)).unwrap_or(preferred)
    }

    /// Which limit keeps [`TraceOptions::structure_for`] from `preferred`, where that reads everything that is set here; `None` where
    /// nothing does, and where other structures are what the options are for.
    pub fn limit_against(&self, preferred: Accel) -> Option<Error> {
        let options = TraceOptions { accel: preferred, ..*self };
        if options.check_that_all_apply().is_ok() { options.validate().err() } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::{Build, Intersector, Memory, Traversal};

    #[test]
    fn what_is_set_decides_before_what_is_fast() {
        let default = TraceOptions::DEFAULT;
        for (options, expected) in [
            (default, Accel::Bvh8),
            (TraceOptions { memory: Memory::Constant, ..default }, Accel::Bvh8),
            (TraceOptions { leaf_size: Some(8), ..default }, Accel::Bvh8),
            (TraceOptions { leaf_size: Some(9), ..default }, Accel::Kd),
            (TraceOptions { build: Build::Median, ..default }, Accel::Kd),
            (TraceOptions { traversal: Traversal::Ropes, ..default }, Accel::Kd),
            (TraceOptions { max_depth: Some(9), ..default }, Accel::Kd),
            (TraceOptions { max_depth: Some(99), ..default }, Accel::Kd),
            (TraceOptions { grid_size: Some([3; 3]), ..default }, Accel::Grid),
            // Nothing reads both: the check of the options says so.
            (TraceOptions { grid_size: Some([3; 3]), build: Build::Median, ..default }, Accel::Bvh8),
        ] {
            assert_eq!(options.structure_for(Accel::Bvh8), expected, "{options:?}");
        }
        let bvh8 = TraceOptions { accel: Accel::Bvh8, ..default };
        for (options, device, expected) in [
            (bvh8, Some(DeviceKind::Cpu), PacketSize::Sixteen),
            (bvh8, Some(DeviceKind::Gpu), PacketSize::One),
            (bvh8, None, PacketSize::One),
            (default, Some(DeviceKind::Cpu), PacketSize::One),
            (TraceOptions { counters: true, ..bvh8 }, Some(DeviceKind::Cpu), PacketSize::One),
            (TraceOptions { intersector: Intersector::Watertight, ..bvh8 }, Some(DeviceKind::Cpu), PacketSize::One),
        ] {
            assert_eq!(options.fastest_packets_on(device), expected, "{options:?}");
        }
        let large = TraceOptions { leaf_size: Some(9), ..default };
        let limit = large.limit_against(Accel::Bvh8).unwrap().to_string();
        assert!(limit.contains("--leaf-size: 9: a leaf of --accel bvh8"), "{limit}");
        assert!(large.limit_against(Accel::Bvh2).is_none() && default.limit_against(Accel::Bvh8).is_none());
        assert!(TraceOptions { build: Build::Median, ..large }.limit_against(Accel::Bvh8).is_none());
        let glass = Material { transmission: glam::Vec3::ONE, ..Material::default() };
        let scene = |material| Scene { materials: vec![Material::default(), material], ..Scene::default() };
        assert!(PacketSize::Sixteen.suits_picture(&scene(Material::default())));
        assert!(
            !PacketSize::Sixteen.suits_picture(&scene(glass.clone())) && PacketSize::One.suits_picture(&scene(glass))
        );
        assert_eq!(Accel::fastest_on(Some(DeviceKind::Cpu)), Accel::Bvh8);
        assert_eq!([Some(DeviceKind::Gpu), None].map(Accel::fastest_on), [Accel::Bvh2; 2]);
    }
}
