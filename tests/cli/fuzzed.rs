//! Inputs of the fuzz targets of the program's own files, as `tests/scene/fuzzed.rs` has those of the library's.

#[path = "../../fuzz/src/program.rs"]
mod targets;

#[test]
fn every_kept_input_holds_and_is_used_or_refused() {
    crate::common::assert_kept_inputs_hold(&targets::TARGETS);
}
