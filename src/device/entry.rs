//! The kernels that the host starts, their files, and the two passes.

use crate::options::{Kernels, PacketSize, TraceOptions};
use crate::shared::PACKETS_OF_ITEM;
use crate::tracer::Task;

/// What traces batches.
pub(super) const TRACE_FILE: &str = "cl/kernels/trace.cl";
/// What counts the hits of batches.
pub(super) const COUNT_HITS_FILE: &str = "cl/kernels/count_hits.cl";
/// What counts them in packets of rays.
pub(super) const COUNT_HITS_PACKETS_FILE: &str = "cl/kernels/count_hits_packets.cl";
/// What lists them in packets of rays.
pub(super) const LIST_HITS_PACKETS_FILE: &str = "cl/kernels/list_hits_packets.cl";
/// What lists them ray by ray.
pub(super) const LIST_HITS_FILE: &str = "cl/kernels/list_hits.cl";
/// What traces batches in packets of rays.
const TRACE_PACKETS_FILE: &str = "cl/kernels/trace_packets.cl";
const RENDER_PACKETS_FILE: &str = "cl/kernels/render_packets.cl";
const RENDER_FILE: &str = "cl/kernels/render.cl";
const ADD_SAMPLES_FILE: &str = "cl/kernels/add_samples.cl";
/// The kernels that [`super::wavefront`] starts.
pub(super) const WAVEFRONT_FILE: &str = "cl/kernels/wavefront.cl";

/// Whether the kernels of this file shade; the others trace batches.
pub(super) fn is_shading(file: &str) -> bool {
    !finds_all_hits(file) && ![TRACE_FILE, TRACE_PACKETS_FILE].contains(&file)
}

/// Whether the kernels of this file count or list all hits.
pub(super) fn finds_all_hits(file: &str) -> bool {
    [COUNT_HITS_FILE, COUNT_HITS_PACKETS_FILE, LIST_HITS_FILE, LIST_HITS_PACKETS_FILE].contains(&file)
}

/// The files of the program that has the kernels of this one.
pub(super) fn files_with(file: &'static str) -> Vec<&'static str> {
    match file {
        RENDER_FILE | RENDER_PACKETS_FILE => vec![file, ADD_SAMPLES_FILE],
        COUNT_HITS_PACKETS_FILE => vec![COUNT_HITS_FILE, file],
        LIST_HITS_PACKETS_FILE => vec![COUNT_HITS_FILE, COUNT_HITS_PACKETS_FILE, file],
        _ => vec![file],
    }
}

/// A kernel that the host starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Entry {
    Render,
    AddSamples,
    TraceClosest,
    TraceAny,
    TraceNext,
    CountHits,
    CountHitsPackets,
    ListHits,
    ListHitsPackets,
    TraceClosestPackets,
    TraceAnyPackets,
    RenderPackets,
}

impl Entry {
    pub const ALL: [Entry; 12] = [
        Entry::Render,
        Entry::AddSamples,
        Entry::TraceClosest,
        Entry::TraceAny,
        Entry::TraceNext,
        Entry::CountHits,
        Entry::CountHitsPackets,
        Entry::ListHits,
        Entry::ListHitsPackets,
        Entry::TraceClosestPackets,
        Entry::TraceAnyPackets,
        Entry::RenderPackets,
    ];

    /// The first kernel that a task of the mega-kernel's needs; that of points has a program of its own.
    pub fn of_task(task: Task, options: &TraceOptions) -> Option<Entry> {
        match task {
            Task::Batch => Some(Entry::of_batch(false, options.packet_size)),
            Task::Counts => Some(Entry::of_counts(options)),
            Task::AllHits => Some(Entry::of_lists(options, u32::MAX)),
            Task::Points => None,
            Task::Picture => Some(Entry::of_picture(options.packet_size)),
        }
    }

    /// What traces a batch.
    pub fn of_batch(any_hit: bool, packet_size: PacketSize) -> Entry {
        match (any_hit, packet_size) {
            (false, PacketSize::One) => Entry::TraceClosest,
            (true, PacketSize::One) => Entry::TraceAny,
            (false, PacketSize::Sixteen) => Entry::TraceClosestPackets,
            (true, PacketSize::Sixteen) => Entry::TraceAnyPackets,
        }
    }

    /// What counts the hits of a batch. Packets do so where each triangle is in one leaf, and what is hit does not
    /// depend on which rays are traced together; they count no work.
    pub fn of_counts(options: &TraceOptions) -> Entry {
        let has_packets = options.packet_size == PacketSize::Sixteen && options.cl_traverse_packets().is_some();
        match has_packets && options.is_exact() && !options.repeats_triangles() && !options.counters {
            true => Entry::CountHitsPackets,
            false => Entry::CountHits,
        }
    }

    /// What lists up to `most` hits of each ray, or first counts them. Packets meet hits in any order, and list all of
    /// a ray's or none. On two cores with PoCL, all hits of a million random rays by packets and the first 3 by single
    /// rays: bunny (2.6 hits a ray) 457 and 897 ms, sponza (7.7) 868 and 920, a bathroom (8.4) 1293 and 1660; the first
    /// 2 by single rays 765, 641 and 1150 ms.
    pub fn of_lists(options: &TraceOptions, most: u32) -> Entry {
        match Entry::of_counts(options) {
            Entry::CountHitsPackets if most > 3 => Entry::ListHitsPackets,
            entry => entry,
        }
    }

    /// What renders a picture, if one kernel does.
    pub fn of_picture(packet_size: PacketSize) -> Entry {
        match packet_size {
            PacketSize::One => Entry::Render,
            PacketSize::Sixteen => Entry::RenderPackets,
        }
    }

    /// What traces again what this one defers: one item each.
    pub fn second(self) -> Entry {
        match self {
            Entry::TraceClosestPackets => Entry::TraceClosest,
            Entry::TraceAnyPackets => Entry::TraceAny,
            Entry::RenderPackets => Entry::Render,
            other => other,
        }
    }

    /// Whether work-items take items from a queue.
    pub fn has_queue(self) -> bool {
        self == Entry::RenderPackets
    }

    /// How many items a work-item has, or takes at a time.
    pub fn items_of_one(self) -> usize {
        match self {
            Entry::TraceClosestPackets
            | Entry::TraceAnyPackets
            | Entry::CountHitsPackets
            | Entry::ListHitsPackets
            | Entry::RenderPackets => PACKETS_OF_ITEM as usize * PacketSize::Sixteen.rays(),
            Entry::TraceClosest
            | Entry::TraceAny
            | Entry::TraceNext
            | Entry::CountHits
            | Entry::ListHits
            | Entry::Render
            | Entry::AddSamples => 1,
        }
    }

    pub fn name(self) -> &'static str {
        match self {
            Entry::Render => "render",
            Entry::AddSamples => "add_samples",
            Entry::TraceClosest => "trace_closest",
            Entry::TraceAny => "trace_any",
            Entry::TraceNext => "trace_next",
            Entry::CountHits => "count_hits",
            Entry::CountHitsPackets => "count_hits_packets",
            Entry::ListHits => "list_hits",
            Entry::ListHitsPackets => "list_hits_packets",
            Entry::TraceClosestPackets => "trace_closest_packets",
            Entry::TraceAnyPackets => "trace_any_packets",
            Entry::RenderPackets => "render_packets",
        }
    }

    /// The file that has it.
    pub fn file(self) -> &'static str {
        match self {
            Entry::Render => RENDER_FILE,
            Entry::AddSamples => ADD_SAMPLES_FILE,
            Entry::RenderPackets => RENDER_PACKETS_FILE,
            Entry::TraceClosestPackets | Entry::TraceAnyPackets => TRACE_PACKETS_FILE,
            Entry::TraceClosest | Entry::TraceAny | Entry::TraceNext => TRACE_FILE,
            Entry::CountHits => COUNT_HITS_FILE,
            Entry::CountHitsPackets => COUNT_HITS_PACKETS_FILE,
            Entry::ListHits => LIST_HITS_FILE,
            Entry::ListHitsPackets => LIST_HITS_PACKETS_FILE,
        }
    }
}

/// Which of the passes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Pass {
    First,
    Second,
}

/// The file with what renders pictures, in the first pass.
pub(super) fn picture_file(options: &TraceOptions) -> &'static str {
    match options.picture.kernels {
        Kernels::Mega => Entry::of_picture(options.packet_size).file(),
        Kernels::Wavefront => WAVEFRONT_FILE,
    }
}

/// The files with the kernels of both passes, of closest and any hits and of pictures. A program has the kernels of
/// one.
pub(super) fn entry_files(options: &TraceOptions) -> Vec<&'static str> {
    let packets = options.packet_size == PacketSize::Sixteen;
    let mut files = vec![TRACE_FILE];
    files.extend(packets.then_some(TRACE_PACKETS_FILE));
    match options.picture.kernels {
        Kernels::Mega => {
            files.push(RENDER_FILE);
            files.extend(packets.then_some(RENDER_PACKETS_FILE));
        }
        Kernels::Wavefront => files.push(WAVEFRONT_FILE),
    }
    files
}
