//! What can be chosen of a kd-tree's build beside where its planes come from: axes, costs and stops (thesis, sections 5.5, 5.5.2).

use super::{Build, OPTIONS, TraceOptions};
use crate::error::{Error, Result};

methods! {
    /// The axis that a build without costs splits first; where a stop refuses that, it tries the others.
    pub enum SplitAxis ("--split-axis") {
        /// x, y, z in turn, by depth.
        Turn = "turn",
        /// The longest one of the cell.
        Longest = "longest",
    }
}

methods! {
    /// What makes a node a leaf before the tree is too deep.
    pub enum Stop ("--stop") {
        /// It has few triangles, or a split costs more than it saves.
        Cost = "cost",
        /// It has few triangles.
        Size = "size",
    }
}

impl Build {
    /// Whether it weighs the costs of planes, and therefore stops by cost unless something else is asked for.
    pub fn weighs_costs(self) -> bool {
        matches!(self, Build::Sah | Build::Volume)
    }
}

/// How a kd-tree is split, and when no more; see also [`super::TraceOptions::leaf_size`] and [`super::TraceOptions::max_depth`].
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct KdOptions {
    /// Which axis is split; only for builds that do not weigh costs.
    #[serde(serialize_with = "super::as_name")]
    pub split_axis: SplitAxis,
    /// Triangles that the median is taken of, at least 1; `None`: [`KdOptions::SAMPLE_SIZE`]. Only for [`Build::SampledMedian`].
    pub sample_size: Option<u32>,
    /// What makes a leaf. `None`: the cost for builds that weigh it, the size for others.
    #[serde(serialize_with = "as_name_or_none")]
    pub stop: Option<Stop>,
    /// Cost of one traversal step, 0 or more; `None`: [`KdOptions::COST`], in packets [`KdOptions::PACKET_COST_TRAVERSE`]. Only where planes or stops go by cost.
    pub cost_traverse: Option<f32>,
    /// Cost of one triangle test, above 0; `None`: [`KdOptions::COST`]. Only where planes or stops go by cost.
    pub cost_intersect: Option<f32>,
    /// Part of its cost that a split with an empty side is spared, 0 to 1; `None`: [`KdOptions::EMPTY_BONUS`]. Only where planes or
    /// stops go by cost.
    pub empty_bonus: Option<f32>,
    /// A split is refused when both children keep more than this share of the triangles, 0 to 1 (1: none is refused). `None`:
    /// [`KdOptions::SIMILAR_CHILDREN`] for builds that do not weigh costs, 1 for others.
    pub similar_children: Option<f32>,
}

fn as_name_or_none<T: std::fmt::Display, S: serde::Serializer>(
    value: &Option<T>,
    serializer: S,
) -> std::result::Result<S::Ok, S::Error> {
    match value {
        Some(value) => serializer.collect_str(value),
        None => serializer.serialize_none(),
    }
}

impl KdOptions {
    /// What is used unless something else is asked for; a constant for tables of options.
    pub const DEFAULT: KdOptions = KdOptions {
        split_axis: SplitAxis::Turn,
        sample_size: None,
        stop: None,
        cost_traverse: None,
        cost_intersect: None,
        empty_bonus: None,
        similar_children: None,
    };

    /// Triangles that a sampled median is taken of: it stands at 50 % ± 5 % (standard deviation) of the triangles. On bunny, sponza,
    /// teapot and gears the expected cost of the tree was 0.2, 1, 4 and -6 % above that of the median.
    pub const SAMPLE_SIZE: u32 = 100;

    /// Cost of a step and of a test. Wald and Havran (2006) take 15 : 20 and a bonus of 20 %. Equal costs gave the same expected
    /// cost, even counted at 15 : 20 (bunny 959 against 962, sponza 1226 against 1229), with 25 % fewer nodes and 13 % fewer
    /// references.
    pub const COST: f32 = 1.0;

    /// Cost of a step where rays are traced in packets, whose triangles take less than a step's intervals of sixteen rays: a frustum leaves
    /// most of them out, eight at a time. Of 1, 2, 5, 10, 20 and 40 on PoCL (bunny, sponza and gears, camera and shadow rays) 10 gave
    /// 1.10 times the speed of 1 and 1.03 of 5, with 5 to 9 % of the nodes of 1.
    pub const PACKET_COST_TRAVERSE: f32 = 10.0;

    /// See [`KdOptions::empty_bonus`] and [`KdOptions::COST`].
    pub const EMPTY_BONUS: f32 = 0.2;

    /// Children that both keep more than this share are nearly alike (the thesis tells no number). On bunny, sponza, teapot and
    /// gears refusing them saved 0.2, 3, 0.1 and 3 % of the expected cost of the median's tree: "at most ~5 %" (section 5.5.2).
    pub const SIMILAR_CHILDREN: f32 = 0.95;

    /// What makes a leaf of `build`.
    pub fn stop(&self, build: Build) -> Stop {
        self.stop.unwrap_or(if build.weighs_costs() { Stop::Cost } else { Stop::Size })
    }

    /// The names of the options that differ from the default.
    fn given(self) -> impl Iterator<Item = &'static str> {
        let options = TraceOptions { kd: self, ..TraceOptions::DEFAULT };
        OPTIONS.iter().filter(move |option| option.is_set(&options)).map(|option| option.name)
    }

    /// Checks the numbers, and that every option means something to `build`.
    pub(super) fn validate(&self, build: Build) -> Result<()> {
        let reads_costs = build.weighs_costs() || self.stop(build) == Stop::Cost;
        for option in self.given() {
            let (is_read, nearest) = match option {
                "--split-axis" => (!build.weighs_costs(), "--build median, sampled-median or spatial-median"),
                "--sample-size" => (build == Build::SampledMedian, "--build sampled-median"),
                "--cost-traverse" | "--cost-intersect" | "--empty-bonus" => {
                    (reads_costs, "--stop cost, or --build sah or volume")
                }
                _ => (true, ""),
            };
            if !is_read {
                let message = format!("means nothing to --build {build}; leave it out, or take {nearest}");
                return Err(Error::option(option, message));
            }
        }
        let finite = f32::MAX;
        let above_0 = f32::from_bits(1);
        for (option, value, range, words) in [
            ("--cost-traverse", self.cost_traverse, 0.0..=finite, "a finite number, 0 or more"),
            ("--cost-intersect", self.cost_intersect, above_0..=finite, "a finite number above 0"),
            ("--empty-bonus", self.empty_bonus, 0.0..=1.0, "a number from 0 to 1"),
            ("--similar-children", self.similar_children, 0.0..=1.0, "a number from 0 to 1"),
        ] {
            if let Some(value) = value.filter(|value| !range.contains(value)) {
                return Err(Error::option(option, format!("{value} is not {words}")));
            }
        }
        if self.sample_size == Some(0) {
            return Err(Error::option("--sample-size", "must be at least 1"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::Accel;
    use super::*;

    const BASE: KdOptions = KdOptions::DEFAULT;

    #[test]
    fn builds_accept_what_they_read_and_name_what_they_do_not() {
        let each = [
            KdOptions { split_axis: SplitAxis::Longest, ..BASE },
            KdOptions { sample_size: Some(5), ..BASE },
            KdOptions { stop: Some(Stop::Size), ..BASE },
            KdOptions { cost_traverse: Some(0.0), ..BASE },
            KdOptions { cost_intersect: Some(2.0), ..BASE },
            KdOptions { empty_bonus: Some(1.0), ..BASE },
            KdOptions { similar_children: Some(0.5), ..BASE },
        ];
        for &build in Build::ALL {
            for kd in each {
                let refused = |kd: KdOptions| {
                    let options = TraceOptions { build, kd, ..TraceOptions::DEFAULT };
                    options.validate().err().map(|error| error.to_string())
                };
                let option = kd.given().next().unwrap();
                let is_cost = option.starts_with("--cost") || option == "--empty-bonus";
                let is_read = match option {
                    "--split-axis" => !build.weighs_costs(),
                    "--sample-size" => build == Build::SampledMedian,
                    _ => !is_cost || build.weighs_costs(),
                };
                let message = refused(kd);
                assert_eq!(message.is_none(), is_read, "{build}, {kd:?}: {message:?}");
                if let Some(message) = message {
                    assert!(message.contains(&format!("{option}: means nothing to --build {build}")), "{message}");
                    assert!(message.contains("or take --"), "{message}");
                }
                if is_cost {
                    assert_eq!(refused(KdOptions { stop: Some(Stop::Cost), ..kd }), None, "{build}, {option}");
                }
                let grid = TraceOptions { accel: Accel::Grid, kd, ..TraceOptions::DEFAULT };
                let message = grid.validate().unwrap_err().to_string();
                assert!(message.contains(option) && message.contains("take --accel kd"), "{message}");
            }
        }
    }

    #[test]
    fn numbers_out_of_range_are_refused() {
        for (kd, hint) in [
            (KdOptions { cost_traverse: Some(-1.0), ..BASE }, "--cost-traverse: -1"),
            (KdOptions { cost_traverse: Some(f32::NAN), ..BASE }, "--cost-traverse: NaN"),
            (KdOptions { cost_traverse: Some(f32::INFINITY), ..BASE }, "0 or more"),
            (KdOptions { cost_intersect: Some(0.0), ..BASE }, "above 0"),
            (KdOptions { empty_bonus: Some(1.5), ..BASE }, "--empty-bonus: 1.5 is not a number from 0 to 1"),
            (KdOptions { empty_bonus: Some(-0.1), ..BASE }, "--empty-bonus"),
            (KdOptions { similar_children: Some(f32::NAN), ..BASE }, "--similar-children"),
            (KdOptions { similar_children: Some(1.1), ..BASE }, "from 0 to 1"),
        ] {
            let message = TraceOptions { kd, ..TraceOptions::DEFAULT }.validate().unwrap_err().to_string();
            assert!(message.contains(hint), "{message}");
        }
        let kd = KdOptions { sample_size: Some(0), ..BASE };
        let sampled = TraceOptions { build: Build::SampledMedian, kd, ..TraceOptions::DEFAULT };
        assert!(sampled.validate().unwrap_err().to_string().contains("--sample-size: must be at least 1"));
    }

    #[test]
    fn options_are_written_flat_and_by_name() {
        let kd = KdOptions { stop: Some(Stop::Size), cost_traverse: Some(0.5), ..BASE };
        let json = serde_json::to_value(TraceOptions { kd, ..TraceOptions::DEFAULT }).unwrap();
        assert_eq!((&json["stop"], &json["cost_traverse"]), (&"size".into(), &0.5.into()));
        assert_eq!((&json["split_axis"], &json["empty_bonus"]), (&"turn".into(), &serde_json::Value::Null));
    }
}
