//! What a device can do at most, measured: drivers tell neither operations nor bytes a second.

use super::{Buffer, Cache, CompileOptions, DeviceContext, DeviceHandle, DeviceKind, Event, ProgramSource, build};
use crate::error::Result;
use crate::layout::Float4;

/// Rates that nothing on the device exceeds, whatever else it does. All are measured by kernels that do nothing else
/// (`cl/kernels/limits.cl`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Products and sums of floats a second, none of them fused: kernels that have the same bits everywhere may not
    /// fuse.
    pub flops: f64,
    /// Bytes a second that work-items read from a small array that all of them read.
    pub cached_bytes: f64,
    /// Bytes a second that a copy from memory to memory reads and writes.
    pub memory_bytes: f64,
}

/// Operations of a work-item in a round of the kernel `arithmetic`.
const FLOPS_A_ROUND: f64 = 128.0;
/// Elements that the kernel `cached_reads` reads, 16 bytes each: the vertices of 30 cubes.
const CACHED_ELEMENTS: usize = 1080;
/// Bytes of either array of the kernel `copy`: more than caches hold.
const COPIED_BYTES: u64 = 256 << 20;
/// A launch that takes this long is not measured by what starting it takes.
const LONG_ENOUGH_S: f64 = 0.01;
/// Launches of which the fastest counts.
const LAUNCHES: usize = 5;

impl Limits {
    /// Measures a device, which takes about a second.
    ///
    /// # Errors
    /// As [`DeviceContext::open`], [`build`] and [`Buffer::empty`].
    pub fn measure(device: &DeviceHandle, cache: Option<&Cache>) -> Result<Limits> {
        let context = DeviceContext::open(device)?;
        let items = if device.info.kind == DeviceKind::Gpu { 1 << 18 } else { 1 << 12 };
        let program = build(&context, &ProgramSource::limits(), &CompileOptions::new(), cache)?.program;

        let sums = Buffer::<[f32; 16]>::empty(&context, "sums", items)?;
        let mut arithmetic = program.kernel("arithmetic")?;
        arithmetic.set_arg(1, 0.5_f32)?;
        arithmetic.set_arg(2, 1.0_f32)?;
        arithmetic.set_arg(3, &sums)?;
        let rate = rounds_a_second(|rounds| {
            arithmetic.set_arg(0, rounds)?;
            arithmetic.launch(&[items], None)
        })?;
        let flops = rate * FLOPS_A_ROUND * items as f64;

        let elements = [Float4::default(); CACHED_ELEMENTS];
        let elements = Buffer::from_slice(&context, "elements", &elements)?;
        let sums = Buffer::<Float4>::empty(&context, "sums", items)?;
        let mut reads = program.kernel("cached_reads")?;
        reads.set_arg(1, CACHED_ELEMENTS as u32)?;
        reads.set_arg(2, &elements)?;
        reads.set_arg(3, &sums)?;
        let rate = rounds_a_second(|rounds| {
            reads.set_arg(0, rounds)?;
            reads.launch(&[items], None)
        })?;
        let cached_bytes = rate * (CACHED_ELEMENTS * size_of::<Float4>() * items) as f64;

        // A limit of 0 is unknown.
        let room = [device.info.max_alloc_bytes, device.info.global_memory_bytes / 4];
        let bytes = room.into_iter().filter(|&bytes| bytes > 0).fold(COPIED_BYTES, u64::min);
        let count = bytes as usize / size_of::<Float4>();
        let from = Buffer::<Float4>::empty(&context, "what is copied", count)?;
        let to = Buffer::<Float4>::empty(&context, "the copy", count)?;
        let mut copy = program.kernel("copy")?;
        copy.set_arg(0, &from)?;
        copy.set_arg(1, &to)?;
        // The first launch gets the memory from the operating system.
        copy.launch(&[count], None)?.wait()?;
        let memory_bytes = (2 * count * size_of::<Float4>()) as f64 / fastest(|| copy.launch(&[count], None))?;
        Ok(Limits { flops, cached_bytes, memory_bytes })
    }
}

/// Seconds of the fastest of some launches.
fn fastest(mut launch: impl FnMut() -> Result<Event>) -> Result<f64> {
    (0..LAUNCHES).try_fold(f64::INFINITY, |least, _| Ok(least.min(launch()?.wait()?)))
}

/// How many rounds a second a kernel makes that does as many as it is told in a launch.
fn rounds_a_second(mut launch: impl FnMut(u32) -> Result<Event>) -> Result<f64> {
    let mut rounds = 1;
    while rounds < 1 << 20 && launch(rounds)?.wait()? < LONG_ENOUGH_S {
        rounds *= 2;
    }
    Ok(f64::from(rounds) / fastest(|| launch(rounds))?)
}
