#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    raybrook_fuzz::turntable_manifest(data);
});
