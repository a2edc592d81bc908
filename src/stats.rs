//! What one run did and how long it took, for `--stats FILE.json`.
//!
//! Times are wall-clock seconds by the host, except `kernel_s`, which the device's own event timers give.

pub use crate::math::median;

use std::path::Path;

use serde::Serialize;

use crate::accel::SplitsChosen;
use crate::choose::Decision;
use crate::error::Result;
use crate::io::aov::AovRange;
use crate::io::compare::FilmDifference;
use crate::io::output::write_json;
use crate::options::TraceOptions;
use crate::scene::Samples;
use crate::shared::COUNTERS;
use crate::tracer::{AdaptiveStats, DeviceShare, LostDevice, Spent, WavefrontStats};
use crate::work::WorkSum;

/// Rays of one kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct RayCount {
    /// How many were cast.
    pub cast: u64,
    /// How many of them hit a triangle.
    pub hit: u64,
}

/// Rays by what they were cast for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct RayCounts {
    /// From the camera, or the rays of a batch.
    pub camera: RayCount,
    /// Towards a light; a hit is an obstacle.
    pub shadow: RayCount,
    /// Off a mirror.
    pub reflected: RayCount,
    /// Through a transparent surface.
    pub refracted: RayCount,
}

impl RayCounts {
    /// From the kernels' counters, in the order of [`crate::shared::COUNTER_NAMES`].
    pub fn from_counters(counters: &[u64; COUNTERS]) -> Self {
        let count = |first: usize| RayCount { cast: counters[first], hit: counters[first + 1] };
        RayCounts { camera: count(0), shadow: count(2), reflected: count(4), refracted: count(6) }
    }

    /// All rays cast; at the most the largest number, as a journal may say anything.
    pub fn total_cast(&self) -> u64 {
        let all = [self.camera, self.shadow, self.reflected, self.refracted];
        all.iter().fold(0, |sum, count| sum.saturating_add(count.cast))
    }
}

/// Counted work of one run.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct WorkStats {
    /// On camera rays, or the rays of a batch.
    pub camera: WorkSum,
    /// On all rays; for a batch also the second ones.
    pub all: WorkSum,
    /// What the colours of the pictures mean that were written.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub aovs: Vec<AovRange>,
}

/// The picture with the most samples in every pixel, and what the one that was written lacks.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FullPicture {
    /// Samples of each pixel.
    pub samples: u32,
    /// Its rays.
    pub rays: RayCounts,
    /// How the picture differs from it.
    pub difference: FilmDifference,
}

/// One run. What does not apply to it is `None` and left out of the file.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct RunStats {
    /// The device's name.
    pub device: String,
    /// "cpu", "gpu", "reference", ...
    pub device_kind: String,
    /// Of several devices what each did.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub shares: Vec<DeviceShare>,
    /// Devices that failed on the way; others did their work, or the reference.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub lost: Vec<LostDevice>,
    /// What the user handed to the device's compiler.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub compiler_options: Option<String>,
    /// The methods and numbers as used.
    pub options: TraceOptions,
    /// What was chosen of these, and why.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub choices: Vec<Decision>,
    /// What [`SpatialSplits::Auto`](crate::options::SpatialSplits::Auto) has chosen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spatial_splits: Option<SplitsChosen>,
    /// Triangles of the scene.
    pub triangle_count: u64,
    /// Render: pixels a row.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub width: Option<u32>,
    /// Render: rows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height: Option<u32>,
    /// Render: samples per pixel, "corners", or the error that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub samples: Option<Samples>,
    /// Render: longest chain of rays.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth: Option<u32>,
    /// Rays of one repeat.
    pub rays: RayCounts,
    /// With [`TraceOptions::counters`]: the work on those rays.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub work: Option<WorkStats>,
    /// Finding the device: most of it the drivers' own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device_s: Option<f64>,
    /// Reading the scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub load_s: Option<f64>,
    /// Building the structure.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub build_s: Option<f64>,
    /// Compiling the kernels, which the device does while the structure is built.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub compile_s: Option<f64>,
    /// Waiting for the device to open and to compile, beyond the time in which the structure was built.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wait_s: Option<f64>,
    /// Copying the scene to the device.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub upload_s: Option<f64>,
    /// Sorting the rays of a batch, where that was done.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sort_s: Option<f64>,
    /// Seconds that the host took for rays whose numbers tracing space cannot hold; not in `kernel_s`. `None` where
    /// there were none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub extreme_s: Option<f64>,
    /// Running the kernel, one entry per repeat.
    pub kernel_s: Vec<f64>,
    /// Rays (of a batch, or of wavefront kernels) or pixels (of the mega-kernel's picture) that only exact integers
    /// could decide: see `cl/intersect/exact.cl`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub second_pass: Option<u64>,
    /// Render: tracing and computing the layers, which are not in `kernel_s`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layers_s: Option<f64>,
    /// Render with the layer of materials: their names, by their numbers.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub materials: Vec<String>,
    /// Copying the result back, and of pictures the places of rays to the device.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub read_s: Option<f64>,
    /// Encoding and writing the picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub write_s: Option<f64>,
    /// How the wavefront kernels went; files keep the name that they had.
    #[serde(rename = "split", skip_serializing_if = "Option::is_none")]
    pub wavefront: Option<WavefrontStats>,
    /// How a picture of bounded error was sampled.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub adaptive: Option<AdaptiveStats>,
    /// What the picture lacks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub full_picture: Option<FullPicture>,
    /// From the start of the program to the end of its output; measuring its error left out.
    pub total_s: f64,
    /// Million rays a second: see [`RunStats::set_rate`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mrays_per_s: Option<f64>,
}

impl RunStats {
    /// Sets `mrays_per_s`: all rays cast in one repeat by the median of `kernel_s`, or `None` without a time above
    /// zero.
    pub fn set_rate(&mut self) {
        self.mrays_per_s =
            median(&self.kernel_s).filter(|&s| s > 0.0).map(|s| self.rays.total_cast() as f64 / s * 1e-6);
    }

    /// The parts of `total_s` that took any time, with their seconds, the longest first; what has no name is the last.
    /// `earlier`: what earlier runs of the program took of a picture that this one went on with. Compiling while the
    /// structure is built is no part: nobody waits for it.
    pub fn parts(&self, earlier: &Spent) -> Vec<(&'static str, f64)> {
        let named = [
            ("finding the device", self.device_s),
            ("reading the scene", self.load_s),
            ("building the structure", self.build_s),
            ("waiting for the device and its compiler", self.wait_s),
            ("copying the scene to the device", self.upload_s),
            ("sorting rays", self.sort_s),
            ("rays that the host takes", self.extreme_s),
            ("running kernels", Some(self.kernel_s.iter().sum::<f64>() - earlier.kernel_s)),
            ("deciding what is traced next", self.adaptive.map(|adaptive| adaptive.decide_s - earlier.decide_s)),
            ("textures on the host", self.wavefront.map(|wavefront| wavefront.host_pass_s)),
            ("copying rays and results", self.read_s.map(|read_s| read_s - earlier.read_s)),
            ("layers", self.layers_s),
            ("encoding and writing", self.write_s),
        ];
        let named = named.into_iter().filter_map(|(name, s)| Some((name, s?))).filter(|&(_, s)| s > 0.0);
        let mut parts: Vec<(&str, f64)> = named.collect();
        parts.sort_by(|a, b| b.1.total_cmp(&a.1));
        let rest = self.total_s - parts.iter().map(|&(_, s)| s).sum::<f64>();
        parts.push(("the rest", rest.max(0.0)));
        parts
    }

    /// Writes the run as JSON that people can read, too.
    ///
    /// # Errors
    /// As [`write_json`].
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        write_json(path.as_ref(), self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::COUNTER_NAMES;
    use serde_json::Value;

    fn written(stats: &RunStats) -> Value {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("stats.json");
        stats.write(&path).unwrap();
        serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
    }

    #[test]
    fn counters_land_where_their_names_say() {
        let counters = std::array::from_fn(|i| i as u64 + 10);
        let json = serde_json::to_value(RayCounts::from_counters(&counters)).unwrap();
        for (index, name) in COUNTER_NAMES.iter().enumerate() {
            let pointer = format!("/{}", name.to_lowercase().replace('_', "/"));
            assert_eq!(json.pointer(&pointer), Some(&Value::from(counters[index])), "{name}");
        }
        assert_eq!(RayCounts::from_counters(&counters).total_cast(), 10 + 12 + 14 + 16);
    }

    #[test]
    fn parts_come_by_their_time_and_the_rest_is_last() {
        let stats = RunStats {
            load_s: Some(0.25),
            build_s: Some(0.5),
            write_s: Some(0.0),
            kernel_s: vec![0.125, 0.25],
            total_s: 1.5,
            ..RunStats::default()
        };
        let expected = [
            ("building the structure", 0.5),
            ("running kernels", 0.375),
            ("reading the scene", 0.25),
            ("the rest", 0.375),
        ];
        let nothing = Spent::default();
        assert_eq!(stats.parts(&nothing), expected);
        let earlier = Spent { kernel_s: 0.25, ..nothing };
        assert_eq!(stats.parts(&earlier)[2], ("running kernels", 0.125));
        // Parts that ran at the same time leave no time less than none.
        assert_eq!(RunStats { total_s: 1.0, ..stats }.parts(&nothing).last(), Some(&("the rest", 0.0)));
    }

    #[test]
    fn what_does_not_apply_is_left_out() {
        let json =
            written(&RunStats { device: "a \"quoted\" name".into(), kernel_s: vec![0.5], ..RunStats::default() });
        let keys: Vec<_> = json.as_object().unwrap().keys().map(String::as_str).collect();
        assert_eq!(keys, ["device", "device_kind", "options", "triangle_count", "rays", "kernel_s", "total_s"]);
        assert_eq!(json["device"], "a \"quoted\" name");
        assert_eq!(json["options"]["accel"], "kd");
        assert_eq!(json["kernel_s"][0], 0.5);
    }

    #[test]
    fn what_applies_is_there() {
        let mut stats =
            RunStats { kernel_s: vec![0.1, 4.0, 0.2], width: Some(3), load_s: Some(1.5), ..RunStats::default() };
        stats.rays.camera = RayCount { cast: 300_000, hit: 7 };
        stats.rays.shadow.cast = 100_000;
        stats.set_rate();
        let json = written(&stats);
        assert_eq!(json["mrays_per_s"], 2.0);
        assert_eq!(json["width"], 3);
        assert_eq!(json["load_s"], 1.5);
        assert_eq!(json["rays"]["camera"]["hit"], 7);
    }

    #[test]
    fn a_rate_needs_a_time() {
        for times in [vec![], vec![0.0]] {
            let mut stats = RunStats { kernel_s: times, ..RunStats::default() };
            stats.set_rate();
            assert_eq!(stats.mrays_per_s, None);
        }
        assert_eq!(median(&[1.0, 2.0, 9.0, 4.0]), Some(3.0));
    }
}
