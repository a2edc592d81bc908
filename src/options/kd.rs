//! How a kd-tree is built and walked (thesis, chapter 5).

use super::structures::{check_costs, check_leaf_size, check_max_depth, check_number};
use super::{Build, NodeOrder, OPTIONS, SplitAxis, Stop, Structure, TraceOptions, Traversal};
use crate::error::{Error, Result};

/// How a kd-tree is built, when it is split no more, and how rays walk through it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KdOptions {
    /// How its planes are chosen.
    pub build: Build,
    /// How rays walk through it.
    pub traversal: Traversal,
    /// Entries of the short stack, 1 to [`TraceOptions::MAX_DEPTH`]; `None`: [`KdOptions::SHORT_STACK`]. Only for
    /// [`Traversal::ShortStack`].
    pub stack_size: Option<u32>,
    /// The order of its nodes in memory.
    pub node_order: NodeOrder,
    /// A node with at most this many triangles is not split; at least 1. `None`: 1 where it stops by cost, else 12 for
    /// the median and the sampled median, 8 for the spatial median, 4 for the others.
    pub leaf_size: Option<u32>,
    /// No leaf is deeper than this, the root counted as 0; at most [`TraceOptions::MAX_DEPTH`]. `None`: 8 + 1.3
    /// log2(triangles).
    pub max_depth: Option<u32>,
    /// Which axis is split; only for builds that do not weigh costs.
    pub split_axis: SplitAxis,
    /// Triangles that the median is taken of, at least 1; `None`: [`KdOptions::SAMPLE_SIZE`]. Only for
    /// [`Build::SampledMedian`].
    pub sample_size: Option<u32>,
    /// What makes a leaf. `None`: the cost for builds that weigh it, the size for others.
    pub stop: Option<Stop>,
    /// Cost of one traversal step, 0 or more; `None`: [`KdOptions::COST`], in packets
    /// [`KdOptions::PACKET_COST_TRAVERSE`]. Only where planes or stops go by cost.
    pub cost_traverse: Option<f32>,
    /// Cost of one triangle test, above 0; `None`: [`KdOptions::COST`]. Only where planes or stops go by cost.
    pub cost_intersect: Option<f32>,
    /// Part of its cost that a split with an empty side is spared, 0 to 1; `None`: [`KdOptions::EMPTY_BONUS`]. Only
    /// where planes or stops go by cost.
    pub empty_bonus: Option<f32>,
    /// A split is refused when both children keep more than this share of the triangles, 0 to 1 (1: none is refused).
    /// `None`: [`KdOptions::SIMILAR_CHILDREN`] for builds that do not weigh costs, 1 for others.
    pub similar_children: Option<f32>,
}

impl KdOptions {
    /// What is used unless something else is asked for.
    pub const DEFAULT: KdOptions = KdOptions {
        build: Build::Sah,
        traversal: Traversal::Stack,
        stack_size: None,
        node_order: NodeOrder::Preorder,
        leaf_size: None,
        max_depth: None,
        split_axis: SplitAxis::Turn,
        sample_size: None,
        stop: None,
        cost_traverse: None,
        cost_intersect: None,
        empty_bonus: None,
        similar_children: None,
    };

    /// Entries of the short stack unless something else is asked for.
    pub const SHORT_STACK: u32 = 8;

    /// Entries of the short stack.
    pub fn short_stack_size(&self) -> u32 {
        self.stack_size.unwrap_or(Self::SHORT_STACK)
    }

    /// Triangles that a sampled median is taken of: it stands at 50 % ± 5 % (standard deviation) of the triangles. On
    /// bunny, sponza, teapot and gears the expected cost of the tree was 0.2, 1, 4 and -6 % above that of the median.
    pub const SAMPLE_SIZE: u32 = 100;

    /// Cost of a step and of a test. Wald and Havran (2006) take 15 : 20 and a bonus of 20 %. Equal costs gave the same
    /// expected cost, even counted at 15 : 20 (bunny 959 against 962, sponza 1226 against 1229), with 25 % fewer nodes
    /// and 13 % fewer references.
    pub const COST: f32 = 1.0;

    /// Cost of a step where rays are traced in packets, whose triangles take less than a step's intervals of sixteen
    /// rays: a frustum leaves most of them out, eight at a time. Of 1, 2, 5, 10, 20 and 40 on PoCL (bunny, sponza and
    /// gears, camera and shadow rays) 10 gave 1.10 times the speed of 1 and 1.03 of 5, with 5 to 9 % of the nodes of 1.
    pub const PACKET_COST_TRAVERSE: f32 = 10.0;

    /// See [`KdOptions::empty_bonus`]. Wald and Havran (2006) take 0.2. Of 0, 0.1, 0.2 and 0.4 this one gave the lowest
    /// expected cost on thirteen of fifteen models: 0.95 to 1.00 of that of 0.2 on all; 0 gave 0.96 to 1.18 of this
    /// one's (docs/record/2026-11-25-host-empty-bonus.md).
    pub const EMPTY_BONUS: f32 = 0.1;

    /// Children that both keep more than this share are nearly alike (the thesis tells no number). On bunny, sponza,
    /// teapot and gears refusing them saved 0.2, 3, 0.1 and 3 % of the expected cost of the median's tree: "at most ~5
    /// %" (section 5.5.2).
    pub const SIMILAR_CHILDREN: f32 = 0.95;

    /// What makes a leaf.
    pub fn stop(&self) -> Stop {
        self.stop.unwrap_or(if self.build.weighs_costs() { Stop::Cost } else { Stop::Size })
    }

    /// The names of the options that differ from the default.
    fn given(self) -> impl Iterator<Item = &'static str> {
        let options = TraceOptions { structure: Structure::Kd(self), ..TraceOptions::DEFAULT };
        OPTIONS.iter().filter(move |option| option.is_set(&options)).map(|option| option.name)
    }

    /// Checks the numbers, and that every option means something to build and traversal.
    pub(super) fn validate(&self) -> Result<()> {
        let build = self.build;
        let reads_costs = build.weighs_costs() || self.stop() == Stop::Cost;
        for option in self.given() {
            let (is_read, nearest) = match option {
                "split_axis" => {
                    (!build.weighs_costs(), "`build = median`, `build = sampled-median` or `build = spatial-median`")
                }
                "sample_size" => (build == Build::SampledMedian, "`build = sampled-median`"),
                "cost_traverse" | "cost_intersect" | "empty_bonus" => {
                    (reads_costs, "`stop = cost`, or `build = sah` or `build = volume`")
                }
                _ => (true, ""),
            };
            if !is_read {
                let message = format!("means nothing to `build = {build}`; leave it out, or take {nearest}");
                return Err(Error::option(option, message));
            }
        }
        check_leaf_size(self.leaf_size)?;
        check_max_depth(self.max_depth)?;
        check_costs(self.cost_traverse, self.cost_intersect)?;
        check_number("empty_bonus", self.empty_bonus, 0.0..=1.0, "a number from 0 to 1")?;
        check_number("similar_children", self.similar_children, 0.0..=1.0, "a number from 0 to 1")?;
        if self.sample_size == Some(0) {
            return Err(Error::option("sample_size", "must be at least 1"));
        }
        let most = TraceOptions::MAX_DEPTH;
        match self.stack_size {
            Some(size) if !(1..=most).contains(&size) => {
                Err(Error::option("stack_size", format!("{size} is not in 1 to {most}")))
            }
            Some(size) if self.traversal != Traversal::ShortStack => {
                let reason = format!(
                    "only the short stack's size can be chosen, a full stack is as large as the tree is deep; nearest: \
                     `traversal = short-stack` `stack_size = {size}`"
                );
                Err(Error::option("stack_size", reason))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BASE: KdOptions = KdOptions::DEFAULT;

    fn refused(kd: KdOptions) -> Option<String> {
        let options = TraceOptions { structure: Structure::Kd(kd), ..TraceOptions::DEFAULT };
        options.validate().err().map(|error| error.to_string())
    }

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
                let option = kd.given().next().unwrap();
                let kd = KdOptions { build, ..kd };
                let is_cost = option.starts_with("cost") || option == "empty_bonus";
                let is_read = match option {
                    "split_axis" => !build.weighs_costs(),
                    "sample_size" => build == Build::SampledMedian,
                    _ => !is_cost || build.weighs_costs(),
                };
                let message = refused(kd);
                assert_eq!(message.is_none(), is_read, "{build}, {kd:?}: {message:?}");
                if let Some(message) = message {
                    assert!(message.contains(&format!("{option}: means nothing to `build = {build}`")), "{message}");
                    assert!(message.contains("or take `"), "{message}");
                }
                if is_cost {
                    assert_eq!(refused(KdOptions { stop: Some(Stop::Cost), ..kd }), None, "{build}, {option}");
                }
            }
        }
    }

    #[test]
    fn numbers_out_of_range_are_refused() {
        for (kd, hint) in [
            (KdOptions { cost_traverse: Some(-1.0), ..BASE }, "cost_traverse: -1"),
            (KdOptions { cost_traverse: Some(f32::NAN), ..BASE }, "cost_traverse: NaN"),
            (KdOptions { cost_traverse: Some(f32::INFINITY), ..BASE }, "0 or more"),
            (KdOptions { cost_intersect: Some(0.0), ..BASE }, "above 0"),
            (KdOptions { empty_bonus: Some(1.5), ..BASE }, "empty_bonus: 1.5 is not a number from 0 to 1"),
            (KdOptions { empty_bonus: Some(-0.1), ..BASE }, "empty_bonus"),
            (KdOptions { similar_children: Some(f32::NAN), ..BASE }, "similar_children"),
            (KdOptions { similar_children: Some(1.1), ..BASE }, "from 0 to 1"),
            (
                KdOptions { build: Build::SampledMedian, sample_size: Some(0), ..BASE },
                "sample_size: must be at least 1",
            ),
        ] {
            let message = refused(kd).unwrap();
            assert!(message.contains(hint), "{message}");
        }
    }
}
