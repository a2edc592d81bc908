//! Inputs of the fuzz targets, and those by which one has failed before, through the same functions.

#[path = "../../fuzz/src/lib.rs"]
mod targets;

#[test]
fn every_kept_input_holds_and_is_used_or_refused() {
    crate::common::assert_kept_inputs_hold(&targets::TARGETS);
}
