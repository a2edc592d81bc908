//! The generated header is fresh. (That host and device agree on every offset is tested in `kernels.rs`.)

use raybrook::low_level::shared::types_cl;

#[test]
fn types_cl_is_fresh() {
    let path = crate::common::root().join("cl/shared/types.cl");
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&path, types_cl()).unwrap();
    }
    let checked_in = std::fs::read_to_string(&path).unwrap_or_default();
    assert_eq!(checked_in, types_cl(), "stale: run `UPDATE=1 cargo test --test device layout`");
}
