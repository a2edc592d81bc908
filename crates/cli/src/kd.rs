//! The options of kd-tree builds.

use clap::Args;
use raybrook::low_level::options::{KdOptions, SplitAxis, Stop};

/// How a kd-tree is split, and when no more.
#[derive(Args)]
pub struct KdArgs {
    #[arg(long, help = format!("Axis that the median builds split first: {}", SplitAxis::names()), value_name = "NAME", default_value_t = KdOptions::DEFAULT.split_axis)]
    split_axis: SplitAxis,
    #[arg(long, help = format!("Triangles that --build sampled-median takes the median of [default: {}]", KdOptions::SAMPLE_SIZE), value_name = "N")]
    sample_size: Option<u32>,
    /// What makes a leaf of a kd-tree: its size, or also a split that would cost more than it saves; size, cost [default: cost for
    /// sah and volume, size for the median builds].
    #[arg(long, value_name = "NAME")]
    stop: Option<Stop>,
    #[arg(long, help = format!("Cost of a step through the kd-tree, where planes or stops go by cost, or through bvh2 [default: {}; {} through kd in packets of rays]", KdOptions::COST, KdOptions::PACKET_COST_TRAVERSE), value_name = "X")]
    cost_traverse: Option<f32>,
    #[arg(long, help = format!("Cost of a triangle test, where planes or stops go by cost, or in bvh2 [default: {}]", KdOptions::COST), value_name = "X")]
    cost_intersect: Option<f32>,
    #[arg(long, help = format!("Part of its cost that a split with an empty side is spared, 0 to 1 [default: {}]", KdOptions::EMPTY_BONUS), value_name = "X")]
    empty_bonus: Option<f32>,
    #[arg(long, help = format!("Refuse splits whose children both keep more than this share of the triangles, 0 to 1 [default: {} for the median builds, 1 for sah and volume]", KdOptions::SIMILAR_CHILDREN), value_name = "X")]
    similar_children: Option<f32>,
}

impl KdArgs {
    pub fn options(&self) -> KdOptions {
        KdOptions {
            split_axis: self.split_axis,
            sample_size: self.sample_size,
            stop: self.stop,
            cost_traverse: self.cost_traverse,
            cost_intersect: self.cost_intersect,
            empty_bonus: self.empty_bonus,
            similar_children: self.similar_children,
        }
    }
}
