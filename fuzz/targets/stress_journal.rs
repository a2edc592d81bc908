#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    raybrook_fuzz::stress_journal(data);
});
