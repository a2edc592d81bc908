//! What NVIDIA's compiler tells of a program with `-cl-nv-verbose`: registers, stack frames and spills, in the words of
//! its assembler ptxas (CUDA Compiler Driver NVCC, section "Verbose output of ptxas").
//!
//! ```text
//! ptxas info    : Compiling entry function 'render' for 'sm_90'
//! ptxas info    : Function properties for render
//!     192 bytes stack frame, 0 bytes spill stores, 0 bytes spill loads
//! ptxas info    : Used 40 registers, 400 bytes cmem[0]
//! ```

use std::collections::HashMap;

/// What one kernel takes; `None` where the log does not tell.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PtxasInfo {
    /// Registers of a work-item, 32 bits each.
    pub registers: Option<u64>,
    /// Bytes of a work-item's arrays and spilled registers.
    pub stack_frame_bytes: Option<u64>,
    /// Bytes of the instructions that spill registers.
    pub spill_store_bytes: Option<u64>,
    /// Bytes of the instructions that read them back.
    pub spill_load_bytes: Option<u64>,
}

/// What the log tells of each kernel. Functions that were not inlined are left out: their frames are not the kernel's
/// own.
pub fn parse(log: &str) -> HashMap<&str, PtxasInfo> {
    let mut kernels: HashMap<&str, PtxasInfo> = HashMap::new();
    let mut entry = None;
    let mut function = None;
    for line in log.lines() {
        if let Some((_, name)) = line.split_once("Compiling entry function '") {
            entry = name.split('\'').next();
            function = entry;
        } else if let Some((_, name)) = line.split_once("Function properties for ") {
            function = Some(name.trim().trim_matches('\''));
        }
        let Some(name) = entry else { continue };
        let info = kernels.entry(name).or_default();
        if function == entry && line.contains("bytes stack frame") {
            info.stack_frame_bytes = number_before(line, "bytes stack frame");
            info.spill_store_bytes = number_before(line, "bytes spill stores");
            info.spill_load_bytes = number_before(line, "bytes spill loads");
        }
        info.registers = number_before(line, "registers").or(info.registers);
    }
    kernels
}

/// The number in front of `words`.
fn number_before(line: &str, words: &str) -> Option<u64> {
    let (before, _) = line.split_once(words)?;
    before.split_whitespace().next_back()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOG: &str = "\
ptxas info    : 0 bytes gmem, 24 bytes cmem[3]
ptxas info    : Compiling entry function 'trace_any' for 'sm_90'
ptxas info    : Function properties for trace_any
    0 bytes stack frame, 0 bytes spill stores, 0 bytes spill loads
ptxas info    : Used 32 registers, used 1 barriers, 16 bytes smem, 392 bytes cmem[0]
ptxas info    : Compiling entry function 'render' for 'sm_90'
ptxas info    : Function properties for shade_surface
    96 bytes stack frame, 8 bytes spill stores, 12 bytes spill loads
ptxas info    : Function properties for render
    192 bytes stack frame, 36 bytes spill stores, 44 bytes spill loads
ptxas info    : Used 255 registers, 400 bytes cmem[0]
";

    #[test]
    fn registers_frames_and_spills_go_to_their_kernels() {
        let kernels = parse(LOG);
        let info = |registers, frame, stores, loads| PtxasInfo {
            registers: Some(registers),
            stack_frame_bytes: Some(frame),
            spill_store_bytes: Some(stores),
            spill_load_bytes: Some(loads),
        };
        assert_eq!(kernels.len(), 2);
        assert_eq!(kernels["trace_any"], info(32, 0, 0, 0));
        assert_eq!(kernels["render"], info(255, 192, 36, 44));
    }

    #[test]
    fn the_older_layout_is_read_too() {
        let log = "ptxas info    : Compiling entry function 'render' for 'sm_35'\n\
                   ptxas info    : Function properties for render\n\
                   ptxas         .     64 bytes stack frame, 4 bytes spill stores, 0 bytes spill loads\n\
                   ptxas info    : Used 40 registers, 400 bytes cmem[0]\n";
        let expected = PtxasInfo {
            registers: Some(40),
            stack_frame_bytes: Some(64),
            spill_store_bytes: Some(4),
            spill_load_bytes: Some(0),
        };
        assert_eq!(parse(log)["render"], expected);
    }

    #[test]
    fn what_a_log_does_not_tell_is_none() {
        assert!(parse("").is_empty());
        assert!(parse("<kernel>:3:1: warning: 40 registers are many\n").is_empty());
        let cut = parse("ptxas info    : Compiling entry function 'render' for 'sm_90'\nUsed many registers");
        assert_eq!(cut["render"], PtxasInfo::default());
    }
}
