//! Memory in large pages. A page of 4 KiB costs about a microsecond when it is first touched: a picture of 4096x4096
//! has 50,000 of them.

/// What is smaller the C library mostly keeps when it is given back, and hands out again with the pages that it has.
const LEAST_BYTES: usize = 32 << 20;

/// Asks the system for large pages where `memory` lies, which will be written as a whole: of what is written in part
/// the rest would be had in vain. Where the system has none, or gives them anyway, nothing changes.
pub fn ask_for<T>(memory: &mut [T]) {
    if size_of_val(memory) >= LEAST_BYTES {
        ask_for_bytes(memory.as_mut_ptr().cast(), size_of_val(memory));
    }
}

#[cfg(target_os = "linux")]
fn ask_for_bytes(start: *mut u8, bytes: usize) {
    // Of x86-64, and of 64-bit Arm with small pages of 4 KiB. Pages that begin or end outside belong to others, too.
    const LARGE_PAGE: usize = 2 << 20;
    let before = start.align_offset(LARGE_PAGE);
    let whole = bytes.saturating_sub(before) / LARGE_PAGE * LARGE_PAGE;
    if whole > 0 {
        // SAFETY: the range lies in `memory`, whose contents stay as they are. A refusal has no consequence.
        let _ = unsafe {
            let first = start.add(before).cast();
            rustix::mm::madvise(first, whole, rustix::mm::Advice::LinuxHugepage)
        };
    }
}

#[cfg(not(target_os = "linux"))]
fn ask_for_bytes(_: *mut u8, _: usize) {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_has_what_it_had() {
        for bytes in [0, 1, LEAST_BYTES - 1, LEAST_BYTES, LEAST_BYTES + 12_345] {
            let mut memory: Vec<u8> = (0..bytes).map(|i| i as u8).collect();
            ask_for(&mut memory);
            assert!(memory.iter().enumerate().all(|(i, &byte)| byte == i as u8), "{bytes}");
        }
    }
}
