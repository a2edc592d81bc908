//! What kernels are compiled with: the definitions that choose the parts of a program, and leave out of it what the
//! scene does not need.

use super::CompileOptions;
use super::entry::{
    COUNT_HITS_FILE, COUNT_HITS_PACKETS_FILE, LIST_HITS_FILE, LIST_HITS_PACKETS_FILE, Pass, TRACE_FILE, finds_all_hits,
    is_shading,
};
use super::scene::DeviceScene;
use crate::features::Features;
use crate::options::{
    Intersector, Kernels, PacketSize, StructureKind, Terminator, TextureFilter, TexturePass, TraceOptions,
};
use crate::pack::SceneBuffers;

/// Registers of kernels with exact hits on NVIDIA's GPUs. What traces needs no more than this in its loops, and the
/// more work-items run at once the more memory's latency is hidden.
const TRACE_REGISTERS: u32 = 56;
/// Of those that shade, and of the second pass: without a limit the calls that decide what double leaves open take 252.
const MOST_REGISTERS: u32 = 168;

/// Rays by which the stack of pending ones grows where it has more than one: it costs memory on every work-item, a
/// recompilation for every depth costs seconds.
const PENDING_STEP: u32 = 8;

/// The definitions of all kernels of a tracer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Definitions {
    /// Of kernels that trace batches: nearly all scenes have the same.
    tracing: CompileOptions,
    /// Of kernels that shade, too.
    shading: CompileOptions,
    /// Whether there are two passes, of which the first leaves rare decisions to the second.
    pub defers: bool,
    /// Whether a triangle may be in several leaves.
    repeats_triangles: bool,
}

impl Definitions {
    /// Of kernels that trace `buffers` with `options`, in chains of at most `max_depth` rays.
    pub fn new(buffers: &SceneBuffers, options: &TraceOptions, max_depth: u32) -> Self {
        let tracing = of_tracing(options, buffers.stack_entries);
        let tracing = DeviceScene::define_constant(tracing, buffers, options);
        Self::with_shading(tracing, buffers.features, options, max_depth)
    }

    /// The same of nearly all scenes of such `features`, but for what of them is in constant memory.
    pub fn of_features(features: Features, options: &TraceOptions, max_depth: u32) -> Self {
        Self::with_shading(of_tracing(options, 1), features, options, max_depth)
    }

    fn with_shading(tracing: CompileOptions, features: Features, options: &TraceOptions, max_depth: u32) -> Self {
        let features = features.in_kernels(options.picture.features);
        let shading = tracing
            .clone()
            .define("FEATURES", format!("{}u", features.bits()))
            .define("SMOOTH_TERMINATOR", u32::from(options.picture.terminator == Terminator::Smooth))
            .define("TEXTURE_FOOTPRINTS", u32::from(options.picture.texture_filter == TextureFilter::Footprint));
        let shading = match options.picture.roulette {
            Some(weight) if weight > 0.0 && features.send_rays() => shading.define("ROULETTE", 1),
            _ => shading,
        };
        let shading = match (options.picture.kernels, features.pending_rays(max_depth)) {
            (Kernels::Wavefront, _) => {
                shading.define("HOST_TEXTURES", u32::from(options.picture.textures == TexturePass::HostPass))
            }
            (Kernels::Mega, 1) => shading.define("MAX_PENDING", 1),
            (Kernels::Mega, rays) => shading.define("MAX_PENDING", rays.next_multiple_of(PENDING_STEP)),
        };
        // Kernels that count keep rare decisions: what they count is the point, not their speed.
        let defers = options.intersector == Intersector::Exact && !options.counters;
        Definitions { tracing, shading, defers, repeats_triangles: options.repeats_triangles() }
    }

    /// The same, of a compiler that tells in its log what kernels take.
    pub fn verbose(self) -> Self {
        Definitions { tracing: self.tracing.verbose(), shading: self.shading.verbose(), ..self }
    }

    /// Those of a pass of the kernels in `file`.
    pub fn of_pass(&self, pass: Pass, file: &str) -> CompileOptions {
        let options = if is_shading(file) { &self.shading } else { &self.tracing }.clone();
        let options = match file {
            COUNT_HITS_FILE if self.repeats_triangles => options.define("AFTER_HITS", 1),
            COUNT_HITS_FILE | COUNT_HITS_PACKETS_FILE => options.define("COUNT_HITS", 1),
            LIST_HITS_PACKETS_FILE => options.define("COUNT_HITS", 1).define("LIST_COUNTED", 1),
            LIST_HITS_FILE => options.define("LIST_HITS", 1),
            _ => options,
        };
        if !self.defers {
            return options;
        }
        match pass {
            // In one pass.
            _ if finds_all_hits(file) => options.most_registers(MOST_REGISTERS),
            Pass::First if file == TRACE_FILE => options.most_registers(TRACE_REGISTERS).define("DEFER_UNDECIDED", 1),
            Pass::First => options.most_registers(MOST_REGISTERS).define("DEFER_UNDECIDED", 1),
            Pass::Second => options.most_registers(MOST_REGISTERS).define("RESOLVE_DEFERRED", 1),
        }
    }
}

/// Entries by which stacks grow: nearly every scene then has the same kernels, which can be compiled before it is
/// known. A hierarchy of eight children a node fills up to seven entries a level. Those that are not used cost nothing
/// but memory.
pub(super) fn stack_step(accel: StructureKind) -> u32 {
    if accel == StructureKind::Bvh8 { 128 } else { 64 }
}

/// Of what traces any scene whose traversal takes so many entries of a stack, but for what is in constant memory.
fn of_tracing(options: &TraceOptions, stack_entries: u32) -> CompileOptions {
    let compile_options = CompileOptions::new()
        .define("TRAVERSE", options.cl_traverse())
        .define("HITS", options.intersector.cl_hits())
        .define("STACK_SIZE", stack_entries.next_multiple_of(stack_step(options.kind())))
        .define("SHORT_STACK_SIZE", options.kd().short_stack_size());
    let compile_options = match options.repeats_triangles() {
        true => compile_options.define("REPEATS_TRIANGLES", 1),
        false => compile_options,
    };
    let compile_options = match options.kind() {
        StructureKind::Bvh8 => compile_options.define("FILTER", options.intersector.cl_filter()),
        _ => compile_options,
    };
    let compile_options = match options.cl_traverse_packets() {
        Some(function) if options.packet_size != PacketSize::One => {
            let compile_options = compile_options.define("TRAVERSE_PACKETS", function);
            match options.intersector.cl_packet_test() {
                Some(test) => compile_options.define("PACKET_TEST", test),
                None => compile_options,
            }
        }
        _ => compile_options,
    };
    let compile_options = match options.intersector.cl_function() {
        Some(function) => compile_options.define("INTERSECT", function),
        None => compile_options,
    };
    DeviceScene::define(compile_options, options)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::PictureOptions;
    use crate::shared::Feature;

    /// Else the same kernels would be compiled twice, and have what nothing needs.
    #[test]
    fn only_scenes_that_send_rays_have_kernels_with_roulette() {
        let plain = Features::ALL.without(Feature::Mirrors).without(Feature::Transparency);
        let definitions = |features: Features, roulette| {
            let picture = PictureOptions { roulette, ..PictureOptions::DEFAULT };
            Definitions::of_features(features, &TraceOptions { picture, ..TraceOptions::DEFAULT }, 5)
        };
        for features in [plain.with(Feature::Mirrors), plain.with(Feature::Transparency), Features::ALL] {
            let [without, off, on, less] = [None, Some(0.0), Some(1.0), Some(0.1)].map(|w| definitions(features, w));
            assert!(without == off && on == less && on != off, "{features}");
            assert_eq!(on.tracing, off.tracing, "batches are traced alike");
        }
        assert_eq!(definitions(plain, Some(1.0)), definitions(plain, None));
    }
}
