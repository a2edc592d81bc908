//! What each kernel takes of a device: what the driver tells of a built kernel, and what its compiler tells in its log.

use super::definitions::Definitions;
use super::entry::{Pass, entry_files, picture_file};
use super::ptxas::{self, PtxasInfo};
use super::{CompileOptions, DeviceContext, DeviceHandle, ProgramSource, build};
use crate::error::Result;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use serde::Serialize;
use std::time::{SystemTime, UNIX_EPOCH};

/// What one kernel takes. `None` where the driver does not tell.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct KernelResources {
    /// The kernel's name.
    pub kernel: String,
    /// Registers of a work-item, 32 bits each.
    pub registers: Option<u64>,
    /// Bytes of the instructions that spill registers.
    pub spill_store_bytes: Option<u64>,
    /// Bytes of the instructions that read them back.
    pub spill_load_bytes: Option<u64>,
    /// Bytes of a work-item's arrays and spilled registers.
    pub stack_frame_bytes: Option<u64>,
    /// Bytes of private memory of a work-item, as the driver counts them.
    pub private_memory_bytes: Option<u64>,
    /// Bytes of local memory of a work-group.
    pub local_memory_bytes: Option<u64>,
    /// The most work-items in a work-group.
    pub max_work_group_size: Option<u64>,
    /// Warp, wavefront or vector width.
    pub preferred_work_group_multiple: Option<u64>,
}

/// What a program takes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ProgramResources {
    /// What was passed to the compiler.
    pub compile_options: String,
    /// Bytes of the binary of all kernels.
    pub binary_bytes: Option<u64>,
    /// What the compiler said.
    #[serde(skip)]
    pub log: String,
    /// Every kernel, sorted by name.
    pub kernels: Vec<KernelResources>,
}

/// Which kernels are looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Looked {
    /// All that trace batches and pictures; where decisions are left to a second pass, its kernels, too.
    All,
    /// Those of the first pass, which does nearly all of the work. Without the sizes of their binaries, for which PoCL
    /// compiles each kernel.
    FirstPass,
    /// The one that renders pictures in the first pass, or those that do together.
    Pictures,
}

/// Builds the kernels that trace `buffers` with `options`, in chains of at most `max_depth` rays, as far as they are
/// `looked` at, and asks what they take: a program for batches and one for pictures, one more of each where rays go in
/// packets, and the same for the second pass.
///
/// # Errors
/// The device cannot be opened or its compiler refuses the kernels.
pub fn kernel_resources(
    device: &DeviceHandle,
    buffers: &SceneBuffers,
    options: &TraceOptions,
    max_depth: u32,
    looked: Looked,
) -> Result<Vec<ProgramResources>> {
    let context = DeviceContext::open(device)?;
    let definitions = Definitions::new(buffers, options, max_depth).verbose();
    let has_second = definitions.defers && looked == Looked::All;
    let passes = [Some(Pass::First), has_second.then_some(Pass::Second)].into_iter().flatten();
    let files = match looked {
        Looked::Pictures => vec![picture_file(options)],
        Looked::All | Looked::FirstPass => entry_files(options),
    };
    let programs = passes.flat_map(|pass| files.iter().map(move |&file| (pass, file)));
    let has_sizes = looked != Looked::FirstPass;
    programs
        .map(|(pass, file)| program_resources(&context, file, &definitions.of_pass(pass, file), has_sizes))
        .collect()
}

fn program_resources(
    context: &DeviceContext,
    file: &str,
    options: &CompileOptions,
    has_size: bool,
) -> Result<ProgramResources> {
    // Without our cache and with a definition that no build had before: a program from a cache, the driver's own
    // included, comes without the compiler's log.
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_nanos());
    let unique = options.clone().define("BUILD_TIME", format!("{now}ul"));
    let built = build(context, &ProgramSource::kernels(&[file]), &unique, None)?;
    let told = ptxas::parse(&built.log);
    let kernels = built.program.kernel_names()?.into_iter().map(|name| {
        let kernel = built.program.kernel(&name)?;
        let PtxasInfo { registers, stack_frame_bytes, spill_store_bytes, spill_load_bytes } =
            told.get(name.as_str()).copied().unwrap_or_default();
        Ok(KernelResources {
            kernel: name,
            registers,
            spill_store_bytes,
            spill_load_bytes,
            stack_frame_bytes,
            private_memory_bytes: kernel.private_memory_bytes().ok(),
            local_memory_bytes: kernel.local_memory_bytes().ok(),
            max_work_group_size: kernel.max_work_group_size().ok().map(|size| size as u64),
            preferred_work_group_multiple: kernel.preferred_work_group_multiple().ok().map(|size| size as u64),
        })
    });
    Ok(ProgramResources {
        compile_options: options.text(context),
        binary_bytes: has_size.then(|| built.program.binary_bytes()).flatten(),
        kernels: kernels.collect::<Result<_>>()?,
        log: built.log,
    })
}
